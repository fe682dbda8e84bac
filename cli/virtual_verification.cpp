#include "cli/virtual_verification.h"

#include "calib/align_record.h"
#include "core/error.h"
#include "core/file.h"
#include "core/value.h"
#include "hw/plc_map.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace fringecal::cli {
namespace {

/// The text or number at a key of a commissioning's file.
template <class Take>
auto taken(const std::filesystem::path& file, const char* key, Take take) {
  const Value document = read_json(file);
  const Value* value = document.find(key);
  const auto* found = value == nullptr ? nullptr : take(*value);
  if (found == nullptr) {
    throw InputError(fmt::format(
        "{}: {} is missing; give the folder of a finished commissioning of the virtual scanner", file.string(), key));
  }
  return *found;
}

std::string text_at(const std::filesystem::path& file, const char* key) {
  return taken(file, key, [](const Value& v) { return v.if_text(); });
}

std::string text_at(const std::filesystem::path& folder, const char* file, const char* key) {
  if (!std::filesystem::exists(folder / file)) {
    throw InputError(
        fmt::format("{}: there is no {} in it; give the folder of a finished commissioning of the virtual "
                    "scanner (fringecal commission --virtual)",
                    folder.string(), file));
  }
  return text_at(folder / file, key);
}

virt::PresetOverrides overrides_of(const std::filesystem::path& file) {
  virt::PresetOverrides out;
  const Value document = read_json(file);
  if (const Value* theta = document.find("theta_mrad")) {
    if (const double* number = theta->if_real()) out.theta_mrad = *number;
    if (const auto* integer = theta->if_integer()) out.theta_mrad = static_cast<double>(*integer);
  }
  return out;
}

}  // namespace

std::vector<metrology::Gauge> gauges_of(const virt::VirtualScanner& instrument, std::uint64_t instrument_seed) {
  using metrology::Gauge;
  using metrology::GaugeKind;
  const auto gauge = [&](const char* name, GaugeKind kind, double expansion) {
    Gauge g{.name = name, .kind = kind};
    g.expansion_per_K = expansion;
    g.u_expansion_per_K = expansion / 20;
    g.U_form_mm = 0.0004;
    g.certificate = fmt::format("VIRTUAL-{}-{}", instrument_seed, name);
    g.laboratory = "virtual laboratory";
    g.date = "2026-01-01";
    g.valid_until = "2099-12-31";
    return g;
  };
  constexpr double kSteel = 11.5e-6, kCeramic = 5.5e-6, kCarbonFibre = 1.0e-6;  // 1/K
  std::vector<Gauge> out;
  for (const char* name : {"sphere50", "sphere38", "sphere30", "cylinder"}) {
    const auto certificate = instrument.certificate_mm(name);
    Gauge g = gauge(name, std::string(name) == "cylinder" ? GaugeKind::cylinder : GaugeKind::sphere, kCeramic);
    g.diameter_mm = {certificate.value};
    g.U_diameter_mm = 2 * certificate.u;
    out.push_back(g);
  }
  out.push_back(gauge("flat", GaugeKind::flat, kSteel));
  if (instrument.has_standard_scene("ball_bar 0")) {
    const auto a = instrument.certificate_mm("bar_a"), b = instrument.certificate_mm("bar_b"),
               bar = instrument.certificate_mm("bar");
    Gauge g = gauge("bar150", GaugeKind::ball_bar, kCarbonFibre);
    g.diameter_mm = {a.value, b.value};
    g.U_diameter_mm = 2 * std::max(a.u, b.u);
    g.distance_mm = bar.value;
    g.U_distance_mm = 2 * bar.u;
    out.push_back(g);
  }
  if (instrument.has_standard_scene("step 0")) {
    const auto height = instrument.certificate_mm("step");
    Gauge g = gauge("step20", GaugeKind::step, kSteel);
    g.distance_mm = height.value;
    g.U_distance_mm = 2 * height.u;
    out.push_back(g);
  }
  if (instrument.has_standard_scene("sphere_plate 0")) {
    Gauge g = gauge("plate5", GaugeKind::sphere_plate, kCeramic);
    for (int k = 1; k <= instrument.plate_spheres(); ++k) {
      const std::string name = fmt::format("plate_{}", k);
      const auto diameter = instrument.certificate_mm(name), x = instrument.certificate_mm(name + "_x"),
                 y = instrument.certificate_mm(name + "_y"), z = instrument.certificate_mm(name + "_z");
      g.diameter_mm.push_back(diameter.value);
      g.U_diameter_mm = 2 * diameter.u;
      g.centres_mm.emplace_back(x.value, y.value, z.value);
      // Two centres with that U in each coordinate; along their line the others do not count. Rounded up to 0.1 um.
      g.U_distance_mm = std::ceil(2e4 * std::hypot(x.u, x.u)) / 1e4;
    }
    out.push_back(g);
  }
  return out;
}

VirtualVerification::VirtualVerification(const std::filesystem::path& folder)
    : folder_(folder),
      preset_(text_at(folder, "commission.json", "preset")),
      seed_(std::stoull(text_at(folder, "commission.json", "seed"))),
      instrument_(preset_, seed_, overrides_of(folder / "commission.json")) {
  if (!std::filesystem::exists(scanner_file())) {
    throw InputError(fmt::format("{}: the commissioning is not finished, scanner.json is missing; run it to its end",
                                 folder.string()));
  }
  // The adjuster's turns, made again: the grating stands as the commissioning left it.
  for (const auto& reading : calib::read_record(folder_ / "alignment" / "record.json").readings) {
    if (reading.turn_before_rad == 0) continue;
    instrument_.turn_adjuster(hw::register_turn_mrad(1e3 * reading.turn_before_rad), state_);
  }
}

std::string VirtualVerification::identification() const {
  return fmt::format("virtual scanner {}, instrument {}", preset_, seed_);
}

void VirtualVerification::befall(const virt::Faults& faults, double room_degC) {
  state_.faults = faults;
  state_.room_degC = room_degC;
}

int VirtualVerification::take_run(const std::string& plan) const {
  const auto folder = folder_ / "verifications";
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  for (int run = 1; run < 1'000'000; ++run) {
    const auto file = folder / fmt::format("{}-{:04}", plan, run);
    const int handle = ::open(file.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0644);
    if (handle >= 0) {
      ::close(handle);
      return run;
    }
    if (errno != EEXIST) {
      throw EnvironmentError(
          fmt::format("{}: {}; give --run N to do without this file", file.string(), std::strerror(errno)));
    }
  }
  throw EnvironmentError(fmt::format("{}: a million verifications are enough; clear it", folder.string()));
}

Capture VirtualVerification::capture(const std::string& plan, const std::string& name, int run, int again) const {
  if (!instrument_.has_standard_scene(name)) {
    throw InputError(
        fmt::format("the virtual scanner has no scene \"{}\"; its preset places what the shipped plans ask "
                    "for",
                    name));
  }
  const std::string which =
      fmt::format("{}/verify/{}/{}{}{}", seed_, plan, name, run > 1 ? fmt::format("/{}", run) : "",
                  again > 0 ? fmt::format(", {} more", again) : "");
  const std::string hash = sha256_hex(which);
  return instrument_.capture(instrument_.standard_scene(name, state_.room_degC, static_cast<std::uint64_t>(run)),
                             state_, std::stoull(hash.substr(0, 16), nullptr, 16));
}

}  // namespace fringecal::cli
