#include "metrology/residual_cloud.h"

#include "core/error.h"

#include <fmt/format.h>

#include <bit>
#include <charconv>
#include <cstring>

namespace fringecal::metrology {
namespace {

static_assert(std::endian::native == std::endian::little, "clouds are written as they stand in memory");
constexpr std::size_t kBytes = 17;  // four floats and a byte
constexpr const char* kBegin =
    "ply\nformat binary_little_endian 1.0\ncomment residual cloud of a fitted feature, mm\n"
    "element vertex ";
constexpr const char* kEnd =
    "\nproperty float x\nproperty float y\nproperty float z\nproperty float deviation\n"
    "property uchar rejected\nend_header\n";

Eigen::Vector3d three(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

}  // namespace

ResidualCloud residual_cloud(std::span<const Eigen::Vector3d> points_mm, std::span<const double> deviations_mm,
                             const std::vector<bool>& rejected) {
  require(points_mm.size() == deviations_mm.size() && points_mm.size() == rejected.size(),
          "points, deviations and marks have one length");
  const std::size_t step = (points_mm.size() + kLargestCloud - 1) / kLargestCloud;
  ResidualCloud out;
  for (std::size_t i = 0; i < points_mm.size(); i += step) {
    out.push_back({points_mm[i].cast<float>(), static_cast<float>(deviations_mm[i]), rejected[i]});
  }
  return out;
}

std::string to_ply(const ResidualCloud& cloud) {
  std::string out = fmt::format("{}{}{}", kBegin, cloud.size(), kEnd);
  std::size_t at = out.size();
  out.resize(at + kBytes * cloud.size());
  for (const auto& point : cloud) {
    const float numbers[4] = {point.position_mm.x(), point.position_mm.y(), point.position_mm.z(), point.deviation_mm};
    std::memcpy(out.data() + at, numbers, sizeof numbers);
    out[at + kBytes - 1] = point.rejected ? 1 : 0;
    at += kBytes;
  }
  return out;
}

ResidualCloud residual_cloud_from(std::string_view ply, const std::string& name) {
  const auto refuse = [&](const char* why) { return InputError(fmt::format("{}: {}", name, why)); };
  if (!ply.starts_with(kBegin)) throw refuse("not a residual cloud; verify writes them into clouds/");
  ply.remove_prefix(std::string_view(kBegin).size());
  std::size_t n = 0;
  const auto [end, error] = std::from_chars(ply.data(), ply.data() + ply.size(), n);
  if (error != std::errc() || n > kLargestCloud) throw refuse("its number of points cannot be read");
  ply.remove_prefix(static_cast<std::size_t>(end - ply.data()));
  if (!ply.starts_with(kEnd)) throw refuse("its header is another one than verify writes");
  ply.remove_prefix(std::string_view(kEnd).size());
  if (ply.size() != n * kBytes) throw refuse("it is cut off or too long");
  ResidualCloud out(n);
  for (std::size_t i = 0; i < n; ++i) {
    float numbers[4];
    std::memcpy(numbers, ply.data() + i * kBytes, sizeof numbers);
    for (const float x : numbers) {
      if (!(std::abs(x) < 1e9f)) throw refuse("a coordinate is not a number");
    }
    out[i] = {{numbers[0], numbers[1], numbers[2]}, numbers[3], ply[i * kBytes + kBytes - 1] != 0};
  }
  return out;
}

void set_box(MeasuredFeature& feature, const ResidualCloud& cloud) {
  require(!cloud.empty(), "a box is around at least one point");
  bool first = true;
  for (const bool with_rejected : {false, true}) {
    for (const auto& point : cloud) {
      if (point.rejected && !with_rejected) continue;
      const Eigen::Vector3d p = point.position_mm.cast<double>();
      feature.low_mm = first ? p : feature.low_mm.cwiseMin(p).eval();
      feature.high_mm = first ? p : feature.high_mm.cwiseMax(p).eval();
      first = false;
    }
    if (!first) return;
  }
}

Value to_value(const MeasuredFeature& f) {
  Value out = Value::object()
                  .set("capture", f.capture)
                  .set("artefact", f.artefact)
                  .set("part", f.part)
                  .set("place_mm", Value::numbers(f.place_mm));
  if (f.cloud.empty()) return out;
  return out.set("low_mm", Value::numbers(f.low_mm))
      .set("high_mm", Value::numbers(f.high_mm))
      .set("cloud", f.cloud)
      .set("cloud_sha256", f.cloud_sha256);
}

MeasuredFeature measured_feature_from(Fields fields) {
  MeasuredFeature f;
  f.capture = fields.text("capture");
  f.artefact = fields.text("artefact");
  f.part = fields.integer("part");
  f.place_mm = three(fields.numbers("place_mm", 3));
  if (fields.has("cloud")) {
    f.low_mm = three(fields.numbers("low_mm", 3));
    f.high_mm = three(fields.numbers("high_mm", 3));
    f.cloud = fields.text("cloud");
    f.cloud_sha256 = fields.text("cloud_sha256");
  }
  fields.finish();
  return f;
}

}  // namespace fringecal::metrology
