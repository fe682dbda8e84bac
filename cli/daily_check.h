// The diagnosis of a plan of one capture: its baseline, and what befell a virtual scanner that is to be diagnosed.
#pragma once

#include "cli/virtual_verification.h"
#include "metrology/plan.h"
#include "metrology/point_cloud.h"
#include "metrology/symptoms.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli {

/// Decoded with all corrections, reconstructed.
metrology::PointCloud cloud_of(const Capture& capture, const model::Scanner& scanner);

/// The gauges of the series, in its order.
std::vector<metrology::Gauge> gauges_in(const metrology::Series& series, const std::vector<metrology::Gauge>& gauges);

/// The mean of a capture's temperature sensors; absent where it has none.
std::optional<double> room_of(const Capture& capture);

/// Of the virtual scanner as its commissioning left it, from a capture of its own. Throws InputError.
metrology::Baseline virtual_baseline(const VirtualVerification& instrument, const metrology::Plan& plan,
                                     const model::Scanner& scanner);

/// What befalls a virtual scanner: of a size that a daily check must see.
struct Injection {
  virt::Faults faults;
  double room_degC = 20;
  double certificate_error_mm = 0;  // on the diameter of sphere50
};
/// "base_line", "knocked_camera", "dirty_projector", "warm_room", "wrong_certificate". Throws InputError with these.
Injection injection_of(const std::string& fault);
void alter_certificate(const Injection& injection, std::vector<metrology::Gauge>& gauges);

}  // namespace fringecal::cli
