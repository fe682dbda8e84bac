#include "reports/plot.h"

#include "core/error.h"
#include "reports/process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <limits>

namespace fringecal::reports {
namespace {

using std::chrono::seconds;

/// PATH for the length of a test.
class ScopedPath {
 public:
  explicit ScopedPath(const char* path) : old_(std::getenv("PATH")) { ::setenv("PATH", path, 1); }
  ~ScopedPath() { ::setenv("PATH", old_.c_str(), 1); }

 private:
  std::string old_;
};

Plot simple_plot() { return {.series = {{.label = "one", .x = {0, 1, 2}, .y = {1, 3, 2}}}}; }

TEST(RunFilter, PassesMoreThanAPipeHoldsBothWays) {
  // 4 MB is beyond every socket buffer, so that reading and writing must alternate.
  const std::string input(4u << 20, 'x');
  const FilterOutput out = run_filter({"cat"}, input, seconds(20), "");
  EXPECT_EQ(out.status, 0);
  EXPECT_EQ(out.output, input);
}

TEST(RunFilter, ReportsTheExitStatusAndTheComplaint) {
  const FilterOutput out = run_filter({"sh", "-c", "echo no >&2; exit 3"}, std::string(1u << 20, 'x'), seconds(20), "");
  EXPECT_EQ(out.status, 3);
  EXPECT_EQ(out.errors, "no\n");
}

TEST(RunFilter, StopsAProgramThatTakesTooLong) {
  try {
    run_filter({"sleep", "30"}, "", seconds(1), "");
    FAIL() << "no complaint";
  } catch (const EnvironmentError& error) {
    EXPECT_STREQ(error.what(), "sleep gave no answer within 1 s and was stopped");
  }
}

TEST(Plot, SaysInOneSentenceThatGnuplotIsMissing) {
  const ScopedPath nowhere("/nonexistent");
  try {
    draw(simple_plot(), "p");
    FAIL() << "no complaint";
  } catch (const EnvironmentError& error) {
    EXPECT_STREQ(error.what(),
                 "gnuplot is not installed; it draws the plots of the report: install the Debian package gnuplot-nox "
                 "and run again");
  }
}

TEST(Plot, HasTheSameBytesTwice) { EXPECT_EQ(draw(simple_plot(), "p").html(), draw(simple_plot(), "p").html()); }

TEST(Plot, TakesHostileWordsAsWords) {
  Plot plot = simple_plot();
  plot.x.label = "'; system('touch /tmp/owned') #\\";
  plot.y.label = "`id` </text><script>alert(1)</script>\nset output";
  plot.series[0].label = "Prüfkörper 陈 %s {/Bold x} @a_b^c";
  const std::string svg = draw(plot, "p").html();
  EXPECT_THAT(svg, testing::HasSubstr("’; system(’touch /tmp/owned’) #\\"));
  EXPECT_THAT(svg, testing::HasSubstr("`id` &lt;/text>&lt;script>alert(1)&lt;/script> set output"));
  EXPECT_THAT(svg, testing::HasSubstr("Prüfkörper 陈 %s {/Bold x} @a_b^c"));
  EXPECT_THAT(svg, testing::Not(testing::HasSubstr("<script")));
}

TEST(Plot, KeepsItsIdsApartFromThoseOfAnotherPlot) {
  Plot plot = simple_plot();
  plot.series[0].mark = Mark::points;
  const std::string svg = draw(plot, "first").html();
  EXPECT_THAT(svg, testing::HasSubstr("href='#first-Pt6'"));
  EXPECT_THAT(svg, testing::HasSubstr("id='first-Pt6'"));
  EXPECT_THAT(svg, testing::Not(testing::HasSubstr("#gp")));
  EXPECT_THAT(svg, testing::Not(testing::HasSubstr("<title>")));
}

TEST(Plot, BreaksALineAtNaN) {
  Plot plot = simple_plot();
  plot.series[0].x = {0, 1, 2, 3, 4};
  plot.series[0].y = {1, 2, std::numeric_limits<double>::quiet_NaN(), 2, 1};
  plot.series[0].label = "";
  const std::string svg = draw(plot, "p").html();
  const std::string line = svg.substr(svg.find("rgb( 11,  90, 122)"));  // ink::kPrimary
  const std::string path = line.substr(0, line.find("/>"));
  EXPECT_EQ(std::count(path.begin(), path.end(), 'M'), 2) << path;
}

TEST(Plot, RefusesColumnsOfDifferentLengthAndInfinity) {
  Plot plot = simple_plot();
  plot.series[0].y.pop_back();
  EXPECT_THROW(draw(plot, "p"), std::logic_error);
  plot.series[0].y.push_back(std::numeric_limits<double>::infinity());
  EXPECT_THROW(draw(plot, "p"), std::logic_error);
}

}  // namespace
}  // namespace fringecal::reports
