#include "core/fields.h"
#include "tests/reports/synthetic_report.h"

#include <gtest/gtest.h>

#include <functional>
#include <set>

namespace fringecal::reports {
namespace {

Value parsed(const CommissioningReport& report) { return parse_json(to_json(to_value(report)), "report.json"); }

std::set<double> numbers_in(const Value& value) {
  std::set<double> out;
  const std::function<void(const Value&)> walk = [&](const Value& v) {
    if (const auto* d = v.if_real()) out.insert(*d);
    if (const auto* i = v.if_integer()) out.insert(static_cast<double>(*i));
    if (const auto* a = v.if_array())
      for (const auto& element : *a) walk(element);
    if (const auto* o = v.if_object())
      for (const auto& [key, element] : *o) walk(element);
  };
  walk(value);
  return out;
}

/// A report whose every number is different from all others, and the list of them.
struct Numbered {
  CommissioningReport report;
  std::vector<double> numbers;
  double next() {
    numbers.push_back(1000.0 + 0.1 * static_cast<double>(numbers.size() + 1));
    return numbers.back();
  }
  int next_whole() {
    numbers.push_back(5000.0 + static_cast<double>(numbers.size()));
    return static_cast<int>(numbers.back());
  }
};

AlignmentSection numbered_alignment(Numbered& n) {
  AlignmentSection a;
  a.tolerance_fraction = n.next();
  a.iterations = {{.number = n.next_whole(),
                   .theta_mrad = {n.next(), n.next()},
                   .bit = n.next_whole(),
                   .delta_um = {n.next(), n.next()},
                   .fraction_of_period = n.next(),
                   .period_px = n.next(),
                   .jump_px = n.next(),
                   .turn_mrad = n.next(),
                   .instruction = "",
                   .verdict = ""}};
  a.before = ProfileColumns{n.next_whole(), {n.next()}, {n.next()}, {n.next()}};
  a.after = ProfileColumns{n.next_whole(), {n.next()}, {n.next()}, {n.next()}};
  return a;
}

CalibrationSection numbered_calibration(Numbered& n) {
  CalibrationSection c;
  c.parameters = {{"a", n.next(), n.next(), "px", ""}};
  c.paper_parameters = {{"b", n.next(), n.next(), "mm", ""}};
  c.residuals = {.camera_rms_px = n.next(),
                 .projector_rms = n.next(),
                 .projector_unit = "mm",
                 .grid_rms_mm = n.next(),
                 .chi2_per_dof = n.next(),
                 .corners_used = n.next_whole(),
                 .corners_rejected = n.next_whole(),
                 .poses = n.next_whole(),
                 .iterations = n.next_whole()};
  c.image_width_px = n.next_whole();
  c.image_height_px = n.next_whole();
  c.camera_residuals = {{n.next(), n.next(), n.next(), n.next()}};
  c.projector_residuals = {{n.next(), n.next(), n.next()}};
  return c;
}

ArtefactSection numbered_artefact(Numbered& n) {
  ArtefactSection a;
  a.certificate_mm = Uncertain{n.next(), n.next()};
  a.paper = {.text = "", .error_limit_mm = n.next(), .form_sd_mm = n.next()};
  a.models = {{.model = "full",
               .mean_diameter_mm = n.next(),
               .error_mm = n.next(),
               .u_error_mm = n.next(),
               .repeatability_sd_mm = n.next(),
               .max_form_sd_mm = n.next(),
               .mean_form_sd_mm = n.next()}};
  a.repeats = {{.diameter_mm = n.next(),
                .form_sd_mm = n.next(),
                .n_points = static_cast<std::size_t>(n.next_whole()),
                .n_rejected = static_cast<std::size_t>(n.next_whole())}};
  return a;
}

TEST(CommissioningJson, HasEveryNumberOfTheStructUnrounded) {
  Numbered n;
  n.report.seed = static_cast<std::uint64_t>(n.next_whole());
  n.report.stages = {{"x", n.next()}};
  n.report.alignment = numbered_alignment(n);
  n.report.calibration = numbered_calibration(n);
  n.report.artefacts = {numbered_artefact(n)};
  const auto found = numbers_in(parsed(n.report));
  for (const double number : n.numbers) EXPECT_TRUE(found.contains(number)) << number;
  // Beyond these there is the schema version only.
  EXPECT_EQ(found.size(), n.numbers.size() + 1);
}

TEST(CommissioningJson, NamesItsSchemaAndTheUnits) {
  Fields fields(parsed(synthetic_report()), "report.json");
  fields.expect_schema("fringecal.report", 1);
  EXPECT_TRUE(fields.boolean("virtual_instrument"));
  EXPECT_EQ(fields.text("verdict"), "not met");
  auto iteration = fields.table("alignment").tables("iterations").at(0);
  EXPECT_DOUBLE_EQ(iteration.number("theta_mrad"), 0.7968);
  EXPECT_DOUBLE_EQ(iteration.number("u_theta_mrad"), 0.0061);
  auto sphere = fields.tables("artefacts").at(1);
  EXPECT_EQ(sphere.text("kind"), "sphere");
  EXPECT_DOUBLE_EQ(sphere.number("certificate_mm"), 30.0012);
  EXPECT_DOUBLE_EQ(sphere.number("u_certificate_mm"), 0.0006);
  EXPECT_EQ(sphere.tables("models").at(2).text("model"), "ideal");
}

TEST(CommissioningJson, LeavesOutWhatIsAbsent) {
  Fields fields(parsed(CommissioningReport{}), "report.json");
  for (const char* key : {"seed", "alignment", "calibration", "phase_map"}) EXPECT_FALSE(fields.has(key)) << key;
  auto report = synthetic_report();
  report.artefacts[1].certificate_mm.reset();
  Fields with(parsed(report), "report.json");
  EXPECT_FALSE(with.tables("artefacts").at(1).has("certificate_mm"));
}

TEST(CommissioningJson, KeepsASeedBeyondSignedIntegersAsText) {
  CommissioningReport report;
  report.seed = 18446744073709551615u;
  Fields fields(parsed(report), "report.json");
  EXPECT_EQ(fields.text("seed"), "18446744073709551615");
}

TEST(CommissioningJson, RefusesANumberThatIsNotFinite) {
  auto report = synthetic_report();
  report.stages[0].duration_s = std::nan("");
  EXPECT_THROW(to_json(to_value(report)), std::logic_error);
}

}  // namespace
}  // namespace fringecal::reports
