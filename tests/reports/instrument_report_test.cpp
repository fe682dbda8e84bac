#include "reports/instrument_report.h"

#include "core/error.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace fringecal::reports {
namespace {

using testing::HasSubstr;
using testing::Not;

Value iteration(double theta_mrad, double delta_um, const char* sentence) {
  return Value::object()
      .set("capture", "flat")
      .set("turn_before_mrad", 0.0)
      .set("measured", Value::object().set("theta_mrad", theta_mrad).set("u_theta_mrad", 0.0042))
      .set("step", Value::object()
                       .set("sentence", sentence)
                       .set("bit", 0)
                       .set("delta_um", delta_um)
                       .set("u_delta_um", 0.46)
                       .set("tolerance_um", 2.4));
}

Value record(Value iterations) {
  return Value::object()
      .set("schema", "fringecal.alignment_record")
      .set("schema_version", 1)
      .set("iterations", std::move(iterations));
}

TEST(AlignmentReport, StatesEveryIterationWithItsUncertainty) {
  const Value two = record(Value::array()
                               .append(iteration(-0.7138, 85.66, "turn <it>"))
                               .append(iteration(0.0061, -0.4, "within tolerance")));
  const auto report = alignment_report(two, "record.json", std::string(64, 'a'), "en");
  EXPECT_EQ(report.results, 2u);
  EXPECT_THAT(report.html, HasSubstr("\u22120.7138 ± 0.0084"));  // U = 2 u, two digits
  EXPECT_THAT(report.html, HasSubstr("85.66 ± 0.92"));
  EXPECT_THAT(report.html, HasSubstr("turn &lt;it&gt;"));
  EXPECT_THAT(report.html, HasSubstr("<svg class=\"turns\""));
  // The tolerance stays visible beside a first value 36 times as large, which is told in figures.
  EXPECT_THAT(report.html, HasSubstr(">2.4</text>"));
  EXPECT_THAT(report.html, HasSubstr(">85.7</text>"));
  EXPECT_THAT(alignment_report(two, "record.json", "", "de").html, HasSubstr("Justierbericht"));
}

TEST(AlignmentReport, RefusesARecordWithoutIterations) {
  EXPECT_THAT(test::message_of<InputError>([&] { alignment_report(record(Value::array()), "r.json", "", "en"); }),
              HasSubstr("no iteration"));
  EXPECT_THROW(alignment_report(Value::object(), "r.json", "", "en"), InputError);
}

TEST(CalibrationReport, StatesParametersWithUncertaintyAndLoadsNothing) {
  model::Scanner scanner;
  scanner.name = "scanner <7>";
  scanner.camera.width_px = 1392;
  scanner.camera.height_px = 1040;
  scanner.camera.fx_px = 3453.81234;
  scanner.method = "joint";
  scanner.uncertainty.names = {"camera.fx_px"};
  scanner.uncertainty.covariance = Eigen::MatrixXd::Constant(1, 1, 0.25);
  model::BoardObservation pose;
  pose.corners = {{.pixel = {100, 200}}, {.pixel = {1300, 900}, .used = false}};
  scanner.observations = {pose};
  const auto report = calibration_report(scanner, std::string(64, 'b'), "en");
  EXPECT_THAT(report.html, HasSubstr("3453.81</td>"));  // to the place of u = 0.50
  EXPECT_THAT(report.html, HasSubstr("0.50"));
  EXPECT_THAT(report.html, HasSubstr("scanner &lt;7&gt;"));
  EXPECT_THAT(report.html, HasSubstr("<svg class=\"coverage\""));
  for (const char* loader : {"<img", "<link", "<script", "url(", "@import", "src=\""}) {
    EXPECT_THAT(report.html, Not(HasSubstr(loader)));
  }
}

TEST(CalibrationReport, ListsFewInputFilesAndCountsMany) {
  model::Scanner scanner;
  scanner.provenance.inputs = {{"pose-00/gray_0.png", "4f2a"}};
  EXPECT_THAT(calibration_report(scanner, "", "en").html, HasSubstr("pose-00/gray_0.png 4f2a"));
  for (int k = 1; k < 165; ++k) scanner.provenance.inputs.emplace_back("pose-" + std::to_string(k), "4f2a");
  const auto many = calibration_report(scanner, "", "en").html;
  EXPECT_THAT(many, HasSubstr("165 input files"));
  EXPECT_THAT(many, Not(HasSubstr("pose-00")));
}

}  // namespace
}  // namespace fringecal::reports
