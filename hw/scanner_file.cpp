#include "hw/scanner_file.h"

#include "core/fields.h"
#include "core/import_plan.h"
#include "hw/device_address.h"

#include <fmt/format.h>

namespace fringecal::hw {
namespace {

std::string code_table(const char* axis, const FringeCode& code) {
  return fmt::format(
      "\n[codes.{}]\ngray_bits = {}\nphase_steps = {}\nstripes_per_period = {}\nperiod = {}\nunit = \"{}\"\n", axis,
      code.gray_bits, code.phase_steps, code.stripes_per_period, code.period, code.unit);
}

}  // namespace

ScannerFile read_scanner_file(const std::filesystem::path& file) {
  Fields fields(read_toml(file), file.string());
  ScannerFile out;
  Fields camera = fields.table("camera");
  out.camera.address = camera.text("address");
  if (const std::string defect = defect_of_camera_address(out.camera.address); !defect.empty()) camera.complain(defect);
  if (const auto format = camera.optional_text("pixel_format")) out.camera.pixel_format = *format;
  out.camera.packet_size_bytes = camera.optional_integer("packet_size_bytes");
  if (const auto size = out.camera.packet_size_bytes; size && (*size < 576 || *size > 16384)) {
    camera.complain(fmt::format("packet_size_bytes is {}; a packet has 576 to 16384 bytes", *size));
  }
  out.exposure_ms = camera.optional_number("exposure_ms");
  if (out.exposure_ms && !(*out.exposure_ms > 0)) {
    camera.complain(fmt::format("exposure_ms is {}; it must be above 0", *out.exposure_ms));
  }
  camera.finish();
  Fields plc = fields.table("plc");
  out.plc_address = plc.text("address");
  try {
    parse_plc_address(out.plc_address);
  } catch (const InputError& e) {
    plc.complain(e.what());
  }
  out.lamp_level = plc.optional_number("lamp_level").value_or(1.0);
  if (!(out.lamp_level > 0 && out.lamp_level <= 1)) {
    plc.complain(fmt::format("lamp_level is {}; it is a share above 0, up to 1", out.lamp_level));
  }
  plc.finish();
  Fields codes = fields.table("codes");
  if (auto x = codes.optional_table("x")) out.plan.x = fringe_code_from(*x);
  if (auto y = codes.optional_table("y")) out.plan.y = fringe_code_from(*y);
  codes.finish();
  const CodeAxis axis = out.plan.x ? CodeAxis::x : CodeAxis::y;
  for (const std::string& words : fields.texts("patterns")) {
    for (const Pattern& pattern : patterns_from(words, axis, file.string() + ": patterns")) {
      out.plan.patterns.push_back(pattern);
    }
  }
  fields.finish();
  if (const std::string defect = defect_of(out.plan); !defect.empty()) fields.complain(defect);
  return out;
}

std::string to_toml(const ScannerFile& scanner) {
  std::string patterns;
  for (const Pattern& pattern : scanner.plan.patterns) {
    patterns += fmt::format("{}\"{}\"", patterns.empty() ? "" : ", ", describe(pattern));
  }
  std::string out = fmt::format("patterns = [{}]\n\n[camera]\naddress = \"{}\"\npixel_format = \"{}\"\n", patterns,
                                scanner.camera.address, scanner.camera.pixel_format);
  if (scanner.camera.packet_size_bytes) {
    out += fmt::format("packet_size_bytes = {}\n", *scanner.camera.packet_size_bytes);
  }
  if (scanner.exposure_ms) out += fmt::format("exposure_ms = {}\n", *scanner.exposure_ms);
  out += fmt::format("\n[plc]\naddress = \"{}\"\nlamp_level = {}\n", scanner.plc_address, scanner.lamp_level);
  if (scanner.plan.x) out += code_table("x", *scanner.plan.x);
  if (scanner.plan.y) out += code_table("y", *scanner.plan.y);
  return out;
}

}  // namespace fringecal::hw
