#include "core/error.h"
#include "core/file.h"
#include "tests/reports/synthetic_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <unistd.h>
#include <cstdlib>
#include <filesystem>
#include <set>

namespace fringecal::reports {
namespace {

using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

constexpr const char* kHostile = "<script>alert(\"1\")</script> & 'Prüfkörper' 陈 `id`";
constexpr const char* kHarmless =
    "&lt;script&gt;alert(&quot;1&quot;)&lt;/script&gt; &amp; &#39;Prüfkörper&#39; 陈 `id`";

/// Every text of the report made hostile.
CommissioningReport hostile_report() {
  auto r = synthetic_report({.poses = 2});
  for (std::string* s : {&r.title,
                         &r.scanner_name,
                         &r.instrument_note,
                         &r.provenance.program,
                         &r.provenance.version,
                         &r.provenance.date,
                         &r.verdict_text,
                         &r.verdicts[0].text,
                         &r.stages[0].name,
                         &r.fringes[0].caption,
                         &r.phase_map->caption,
                         &r.alignment->conclusion,
                         &r.alignment->iterations[0].instruction,
                         &r.alignment->iterations[0].verdict,
                         &r.calibration->method,
                         &r.calibration->parameters[0].name,
                         &r.calibration->parameters[0].unit,
                         &r.calibration->parameters[0].meaning,
                         &r.calibration->poses[0].name,
                         &r.calibration->poses.back().name,
                         &r.calibration->poses.back().reason,
                         &r.calibration->residuals.projector_unit,
                         &r.artefacts[0].name,
                         &r.artefacts[0].paper.text,
                         &r.artefacts[0].criterion,
                         &r.artefacts[0].models[1].model,
                         &r.artefacts[0].deviation_caption}) {
    *s = kHostile;
  }
  r.provenance.inputs[0] = {kHostile, kHostile};
  r.artefacts[0].remarks = {kHostile};
  return r;
}

/// For tests that look at words only: a page without plots takes a tenth of the time.
CommissioningReport report_without_plots() {
  auto r = synthetic_report({.poses = 2});
  r.alignment->before.reset();
  r.alignment->after.reset();
  r.calibration->camera_residuals.clear();
  r.calibration->projector_residuals.clear();
  for (auto& artefact : r.artefacts) artefact.repeats.clear();
  return r;
}

std::size_t count(const std::string& in, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = in.find(what); at != std::string::npos; at = in.find(what, at + what.size())) ++n;
  return n;
}

/// The end of the tag that opens at `at`: the first > outside quotes.
std::size_t tag_end(const std::string& s, std::size_t at) {
  char quote = 0;
  for (; at < s.size(); ++at) {
    if (quote == 0 && (s[at] == '"' || s[at] == '\'')) {
      quote = s[at];
    } else if (s[at] == quote) {
      quote = 0;
    } else if (quote == 0 && s[at] == '>') {
      return at;
    }
  }
  return std::string::npos;
}

/// The first tag that closes nothing, or the last one not closed; empty where all is balanced.
std::string unbalanced(const std::string& html) {
  const std::set<std::string> empty_elements = {"meta", "img", "br", "!DOCTYPE"};
  std::vector<std::string> open;
  for (std::size_t at = html.find('<'); at != std::string::npos; at = html.find('<', at + 1)) {
    const std::size_t end = tag_end(html, at);
    if (end == std::string::npos) return html.substr(at, 80);
    const bool closes = html[at + 1] == '/';
    const std::size_t first = at + (closes ? 2 : 1);
    const std::string name = html.substr(first, html.find_first_of(" \n\t/>", first) - first);
    if (closes) {
      if (open.empty() || open.back() != name) return html.substr(at, end + 1 - at);
      open.pop_back();
    } else if (html[end - 1] != '/' && !empty_elements.contains(name)) {
      open.push_back(name);
    }
    at = end;
  }
  return open.empty() ? "" : open.back();
}

/// What stands in every src and href, the first few characters.
std::vector<std::string> references(const std::string& html) {
  std::vector<std::string> out;
  for (const std::string attribute : {"src=", "href="}) {
    for (std::size_t at = html.find(attribute); at != std::string::npos; at = html.find(attribute, at + 1)) {
      out.push_back(html.substr(at + attribute.size() + 1, 5));
    }
  }
  return out;
}

void remove_all(std::string& s, const std::string& what) {
  for (std::size_t at = s.find(what); at != std::string::npos; at = s.find(what, at)) s.erase(at, what.size());
}

TEST(CommissioningReport, ShowsEveryTextEscaped) {
  const std::string html = commissioning_html(hostile_report());
  EXPECT_THAT(html, Not(HasSubstr("<script")));
  // 27 texts, two in the inputs and one remark; each stands on the page at least once.
  EXPECT_GE(count(html, kHarmless), 30u);
}

TEST(CommissioningReport, IsBalancedMarkup) {
  EXPECT_EQ(unbalanced(commissioning_html(synthetic_report({.poses = 2}))), "");
  EXPECT_EQ(unbalanced("<p><b></p>"), "</p>");
}

TEST(CommissioningReport, LoadsNothingFromAnywhere) {
  std::string html = commissioning_html(synthetic_report({.poses = 2}));
  remove_all(html, "xmlns=\"http://www.w3.org/2000/svg\"");
  remove_all(html, "xmlns:xlink=\"http://www.w3.org/1999/xlink\"");
  EXPECT_THAT(html, Not(HasSubstr("http:")));
  EXPECT_THAT(html, Not(HasSubstr("https:")));
  EXPECT_THAT(html, Not(HasSubstr("@import")));
  EXPECT_THAT(html, Not(HasSubstr("url(")));
  EXPECT_THAT(html, Not(HasSubstr("<link")));
  const auto targets = references(html);
  for (const auto& target : targets) EXPECT_TRUE(target.starts_with("#") || target == "data:") << target;
  EXPECT_GT(targets.size(), 20u);  // eleven frames, five deviation maps and their bars, the phase map
}

TEST(CommissioningReport, HasTheSameBytesForTheSameStruct) {
  const auto report = synthetic_report({.poses = 2});
  const std::string html = commissioning_html(report), json = to_json(to_value(report));
  ::setenv("SOURCE_DATE_EPOCH", "1", 1);
  ::setenv("TZ", "Asia/Shanghai", 1);
  EXPECT_EQ(commissioning_html(report), html);
  EXPECT_EQ(to_json(to_value(report)), json);
  ::unsetenv("SOURCE_DATE_EPOCH");
  ::unsetenv("TZ");
}

TEST(CommissioningReport, SaysThatAVirtualInstrumentIsNotReal) {
  auto report = report_without_plots();
  EXPECT_THAT(commissioning_html(report), HasSubstr("Virtual instrument, not a real one."));
  report.virtual_instrument = false;
  EXPECT_THAT(commissioning_html(report), Not(HasSubstr("irtual instrument, not a real one")));
}

TEST(CommissioningReport, PutsThePapersFigureBesideOurs) {
  const std::string html = commissioning_html(report_without_plots());
  // Sphere 30 mm: certificate ± U, mean of ten, error, u, form sd; the paper's error limit and form sd.
  for (const char* words : {">30.0012 ± 0.0012<", ">29.9959<", ">−5.3<", ">1.6<", ">31.2<", ">&lt; 40<", ">34<"}) {
    EXPECT_THAT(html, HasSubstr(words));
  }
}

TEST(CommissioningReport, TellsAVerdictByAWordAndAShapeToo) {
  const std::string html = commissioning_html(report_without_plots());
  for (const char* words : {"</span> met</span>", "</span> not met</span>", "(not judged)"})
    EXPECT_THAT(html, HasSubstr(words));
}

TEST(CommissioningReport, ShadesTheJumpsBeforeAlignmentAndFindsNoneAfter) {
  const std::string html = commissioning_html(synthetic_report({.poses = 2}));
  EXPECT_THAT(
      html,
      HasSubstr("Before alignment, zoom on period edges: between a Gray edge and the period edge the phase jumps"));
  EXPECT_THAT(html, HasSubstr("After alignment, zoom on period edges: no jump in this window"));
}

TEST(CommissioningReport, IsAPageEvenWhenNothingWasMeasured) {
  const std::string html = commissioning_html(CommissioningReport{});
  EXPECT_EQ(unbalanced(html), "");
  EXPECT_THAT(html, HasSubstr("Unnamed scanner"));
  for (const char* id : {"alignment", "fringes", "phase", "calibration", "artefacts", "models"}) {
    EXPECT_THAT(html, Not(HasSubstr("id=\"" + std::string(id) + "\""))) << id;
  }
}

TEST(CommissioningReport, DoesWithoutWhatIsOptional) {
  auto report = synthetic_report({.poses = 2});
  auto& sphere = report.artefacts[1];
  sphere.certificate_mm.reset();
  sphere.models = {{.model = "full", .mean_diameter_mm = 29.9959, .max_form_sd_mm = 0.0312, .mean_form_sd_mm = 0.03}};
  sphere.paper = {};
  sphere.deviation_mm = {};
  report.artefacts[2].models.clear();
  report.artefacts[2].repeats.clear();
  report.artefacts[3].repeats[2].diameter_mm.reset();
  report.alignment->before.reset();
  report.alignment->after.reset();
  report.calibration->coverage.reset();
  report.calibration->camera_residuals.clear();
  report.calibration->projector_residuals.clear();
  for (auto& parameter : report.calibration->paper_parameters) parameter.u.reset();
  report.phase_map->valid = {};
  const std::string html = commissioning_html(report);
  EXPECT_EQ(unbalanced(html), "");
  EXPECT_THAT(html, HasSubstr("Not measured."));
  EXPECT_THAT(html, Not(HasSubstr("zoom")));
}

TEST(CommissioningReport, RefusesAProfileWithColumnsOfDifferentLength) {
  auto report = synthetic_report({.poses = 2});
  report.alignment->before->phase_rad.pop_back();
  EXPECT_THROW(commissioning_html(report), std::logic_error);
}

TEST(CommissioningReport, OfAFullSizeInstrumentStaysBelowFourMegabytes) {
  const std::string html = commissioning_html(synthetic_report({.width_px = 1392, .height_px = 1040, .poses = 24}));
  EXPECT_LT(html.size(), 4u << 20);
}

TEST(CommissioningReport, ChecksItsToolsBeforeALongRun) {
  EXPECT_NO_THROW(check_report_tools());
  const std::string path = std::getenv("PATH");
  ::setenv("PATH", "/nonexistent", 1);
  EXPECT_THROW(check_report_tools(), EnvironmentError);
  ::setenv("PATH", path.c_str(), 1);
}

TEST(CommissioningReport, WritesBothFilesOrSaysWhyNot) {
  const fs::path folder = fs::temp_directory_path() / ("fringecal-report-" + std::to_string(::getpid()));
  const auto report = report_without_plots();
  write_commissioning_report(folder, report);
  EXPECT_EQ(read_bytes(folder / "report.html"), commissioning_html(report));
  EXPECT_EQ(read_bytes(folder / "report.json"), to_json(to_value(report)));
  EXPECT_THROW(write_commissioning_report(folder / "report.html" / "below", report), EnvironmentError);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace fringecal::reports
