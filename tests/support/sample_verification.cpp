#include "tests/support/sample_verification.h"

#include "core/file.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <string>

namespace fringecal::test {
namespace {

using metrology::Contribution;
using metrology::Evaluation;
using metrology::Form;

struct Sample {
  const char *symbol, *name, *artefact, *position;
  double value_mm;
  metrology::Limits limits;
  double u_certificate_mm;
};

metrology::Quantity quantity_of(const Sample& s, double shift_mm) {
  metrology::Quantity q{.symbol = s.symbol, .name = s.name, .artefact = s.artefact, .position = s.position};
  q.value = s.value_mm + shift_mm;
  q.budget = {{.name = "certificate of the artefact", .u = s.u_certificate_mm, .sensitivity = -1},
              {.name = "repeatability of the mean",
               .evaluation = Evaluation::type_a,
               .form = Form::student_t,
               .u = 0.0013,
               .nu = 9},
              {.name = "thermal expansion coefficient", .form = Form::rectangular, .u = 0.00021},
              {.name = "temperature of the artefact", .form = Form::rectangular, .u = 0.00034},
              {.name = "form of the artefact", .u = 0.0004}};
  q.uncertainty = metrology::combine(q.budget);
  if (s.limits.lower || s.limits.upper) {
    q.limits = s.limits;
    q.judgement = metrology::judge(q.value, q.uncertainty, s.limits, metrology::DecisionRule::iso_14253_1);
  }
  q.u_of_later_measurements = 0.006;
  q.n_points = 41'210;
  q.n_rejected = 118;
  return q;
}

}  // namespace

metrology::Verification sample_verification(double shift_mm) {
  metrology::Verification v;
  v.plan = "vdi2634-2";
  v.plan_source = "VDI/VDE 2634 part 2 (2012)";
  v.plan_unchecked = {"The standard's text was not at hand: positions and counts are those of public summaries."};
  v.scanner = "chen2008 seed 1";
  v.scanner_file_sha256 = std::string(64, 'a');
  v.begun = "2026-11-20T08:12:00Z";
  v.ended = "2026-11-20T10:47:31Z";
  v.environment = {.temperature_degC = 20.3, .u_temperature_degC = 0.15, .humidity_percent = 46};
  v.decision_rule = metrology::DecisionRule::iso_14253_1;
  v.artefacts = {{.name = "sphere 30",
                  .kind = "sphere",
                  .certificate = "K-2026-0815",
                  .laboratory = "D-K-15000-01-00",
                  .date = "2026-03-01",
                  .valid_until = "2028-03-01",
                  .values = {{"diameter", 30.0043, 0.0006, 2}}},
                 {.name = "ball bar 150",
                  .kind = "ball_bar",
                  .certificate = "K-2026-0816",
                  .laboratory = "D-K-15000-01-00",
                  .date = "2026-03-01",
                  .valid_until = "2028-03-01",
                  .values = {{"diameter", 30.0012, 0.0006, 2}, {"distance", 150.0131, 0.0012, 2}}},
                 {.name = "flat 500",
                  .kind = "flat",
                  .certificate = "K-2025-1207",
                  .laboratory = "D-K-15000-01-00",
                  .date = "2025-12-07",
                  .valid_until = "2027-12-07",
                  .values = {{"form", 0.0021, 0.0008, 2}}}};
  const std::array<Sample, 13> samples = {{
      {"PF", "probing error, form", "sphere 30", "1", 0.0612, {.lower = {}, .upper = 0.10}, 0.0002},
      {"PF", "probing error, form", "sphere 30", "2", 0.0587, {.lower = {}, .upper = 0.10}, 0.0002},
      {"PF", "probing error, form", "sphere 30", "3", 0.0703, {.lower = {}, .upper = 0.10}, 0.0002},
      {"PS", "probing error, size", "sphere 30", "1", -0.0041, {.lower = -0.03, .upper = 0.03}, 0.0003},
      {"PS", "probing error, size", "sphere 30", "2", 0.0112, {.lower = -0.03, .upper = 0.03}, 0.0003},
      {"PS", "probing error, size", "sphere 30", "3", 0.0289, {.lower = -0.03, .upper = 0.03}, 0.0003},
      {"SD", "sphere-spacing error", "ball bar 150", "1", -0.0123, {.lower = -0.05, .upper = 0.05}, 0.0006},
      {"SD", "sphere-spacing error", "ball bar 150", "2", 0.0074, {.lower = -0.05, .upper = 0.05}, 0.0006},
      {"SD", "sphere-spacing error", "ball bar 150", "3", -0.0210, {.lower = -0.05, .upper = 0.05}, 0.0006},
      {"SD", "sphere-spacing error", "ball bar 150", "worst of 7", -0.0312, {.lower = -0.05, .upper = 0.05}, 0.0006},
      {"F", "flatness measurement error", "flat 500", "1", 0.0874, {.lower = {}, .upper = 0.12}, 0.0004},
      {"F", "flatness measurement error", "flat 500", "2", 0.0931, {.lower = {}, .upper = 0.12}, 0.0004},
      {"D", "error of the mean diameter", "sphere 30", "mean of 10", 0.0006, {}, 0.0003},
  }};
  for (const auto& sample : samples) v.quantities.push_back(quantity_of(sample, shift_mm));
  v.deviations = {};
  v.provenance = {.program = "fringecal",
                  .version = "0.1.0",
                  .date = "2026-11-20T10:47:40Z",
                  .inputs = {{"scanner.json", std::string(64, 'a')}}};
  return v;
}

void add_features(metrology::Verification& v, const std::filesystem::path& folder) {
  struct Part {
    const char *capture, *artefact;
    int part;
    Eigen::Vector3d place_mm;
    double size_mm;  // of a cap, or of a plane
  };
  const auto add = [&](const Part& one) {
    std::vector<Eigen::Vector3d> points;
    std::vector<double> deviations;
    for (int i = -20; i <= 20; ++i) {
      for (int k = -20; k <= 20; ++k) {
        const double x = i / 20.0, y = k / 20.0;
        if (one.size_mm < 100 && x * x + y * y > 1) continue;
        points.push_back(one.place_mm + one.size_mm / 2 * Eigen::Vector3d(x, y, 0.3 * (1 - x * x - y * y)));
        deviations.push_back(0.02 * std::sin(4 * x) + 0.01 * y * one.place_mm.z() / 100);
      }
    }
    const auto cloud = metrology::residual_cloud(points, deviations, std::vector<bool>(points.size()));
    const std::string bytes = metrology::to_ply(cloud);
    metrology::MeasuredFeature feature{.capture = one.capture, .artefact = one.artefact, .part = one.part};
    feature.place_mm = one.place_mm;
    metrology::set_box(feature, cloud);
    feature.cloud = fmt::format("clouds/{}-{}.ply", one.capture, one.part + 1);
    feature.cloud_sha256 = sha256_hex(bytes);
    write_atomically(folder / feature.cloud, bytes);
    v.features.push_back(feature);
  };
  for (int k = 0; k < 3; ++k) {
    const std::string number = fmt::format("-{:02}", k), probing = "probing" + number, bar = "bar" + number,
                      flat = "flat" + number;
    const Eigen::Vector3d at(-120 + 110 * k, 60 - 70 * k, 40 * k - 30);
    add({probing.c_str(), "sphere 30", 0, at, 30});
    add({bar.c_str(), "ball bar 150", 0, at + Eigen::Vector3d(-70, 30, 10), 30});
    add({bar.c_str(), "ball bar 150", 1, at + Eigen::Vector3d(70, -20, -20), 30});
    add({flat.c_str(), "flat 500", 0, Eigen::Vector3d(10, 0, 60.0 * k - 60), 300});
  }
}

std::string sample_laboratory(bool test) {
  return std::string("schema = \"fringecal.laboratory\"\nschema_version = 1\n") + (test ? "test = true\n" : "") +
         R"(accreditation = "D-K-99999-01-00"
place = "laboratory"
procedure = "QM-AA-017"

[address]
name = "Kalibrierlaboratorium Beispiel GmbH"
street = "Musterstraße"
street_no = "1"
post_code = "38116"
city = "Braunschweig"
country_code = "DE"
email = "kalibrierung@example.org"
phone = "+49 531 1234-0"

[[persons]]
name = "Dr. Erika Mustermann"
role = "Head of the laboratory"
main_signer = true

[[persons]]
name = "Max Müller"
role = "Calibrated by"
)";
}

std::string sample_customer(const std::string& free_text) {
  return R"(schema = "fringecal.customer"
schema_version = 1
order = "4500123456"
recalibration_date = "2027-11-30"
remarks = '''
)" + free_text +
         R"('''

[address]
name = "Formenbau Beispiel & Söhne KG"
street = "Werkstraße"
street_no = "12a"
post_code = "70565"
city = "Stuttgart"
country_code = "DE"

[item]
name = "Fringe-projection 3D scanner"
manufacturer = "Beispiel Optik"
model = "FP-1392"
serial_number = "0007-2026"
inventory_number = "MM-118"
condition = '''
)" + free_text +
         R"('''
received = "2026-11-18"
)";
}

}  // namespace fringecal::test
