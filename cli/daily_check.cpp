#include "cli/daily_check.h"

#include "calib/decode/corrections.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/instrument_record.h"
#include "metrology/reconstruct.h"

#include <fmt/format.h>

namespace fringecal::cli {

metrology::PointCloud cloud_of(const Capture& capture, const model::Scanner& scanner) {
  const auto measured = decode::decode_for_measuring(capture, scanner.projector.main_axis(),
                                                     scanner.linearisation ? &*scanner.linearisation : nullptr);
  return metrology::reconstruct(measured.map, scanner, {.normals = false}).cloud;
}

std::vector<metrology::Gauge> gauges_in(const metrology::Series& series, const std::vector<metrology::Gauge>& gauges) {
  std::vector<metrology::Gauge> out;
  for (const auto& name : series.artefacts) out.push_back(metrology::gauge_named(gauges, name));
  return out;
}

std::optional<double> room_of(const Capture& capture) {
  const auto temperature = metrology::temperature_of({capture.info});
  return temperature ? std::optional(temperature->value) : std::nullopt;
}

metrology::Baseline virtual_baseline(const VirtualVerification& instrument, const metrology::Plan& plan,
                                     const model::Scanner& scanner) {
  const auto& series = plan.series.front();
  constexpr int kPlaceOfBaseline = 9000;  // no daily check has this number
  const Capture capture = instrument.capture(plan.name, fmt::format("{} {}", series.scene, kPlaceOfBaseline));
  const auto cloud = cloud_of(capture, scanner);
  auto baseline = metrology::baseline_of({cloud, scanner, gauges_in(series, instrument.gauges()), room_of(capture)});
  if (!baseline) throw InputError(fmt::format("baseline: {}", baseline.error().sentence));
  baseline->date = utc_now();
  baseline->scanner_file_sha256 = sha256_of_file(instrument.scanner_file());
  return *baseline;
}

Injection injection_of(const std::string& fault) {
  Injection out;
  if (fault == "base_line") {
    out.faults.base_mm = 0.1;
  } else if (fault == "knocked_camera") {
    out.faults.camera_turn_rad = {0.2e-3, -0.3e-3, 0.3e-3};
  } else if (fault == "dirty_projector") {
    out.faults.projector_transmission = 0.65;
    out.faults.projector_veil = 0.1;
  } else if (fault == "warm_room") {
    out.room_degC = 28;
  } else if (fault == "wrong_certificate") {
    out.certificate_error_mm = 0.1;
  } else {
    throw InputError(fmt::format(
        "--fault {}: there is no such fault; there are: base_line, knocked_camera, dirty_projector, warm_room, "
        "wrong_certificate",
        fault));
  }
  return out;
}

void alter_certificate(const Injection& injection, std::vector<metrology::Gauge>& gauges) {
  for (auto& gauge : gauges) {
    if (gauge.name == "sphere50") gauge.diameter_mm.front() += injection.certificate_error_mm;
  }
}

}  // namespace fringecal::cli
