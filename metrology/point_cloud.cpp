#include "metrology/point_cloud.h"

#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>

namespace fringecal::metrology {
namespace {

static_assert(std::endian::native == std::endian::little, "the PLY body is written as it lies in memory");

constexpr const char* kProperties =
    "property double x\nproperty double y\nproperty double z\n"
    "property float nx\nproperty float ny\nproperty float nz\n"
    "property float u_mm\nproperty float modulation\n"
    "property ushort pixel_x\nproperty ushort pixel_y\n";
constexpr const char* kDeviation = "property float deviation_mm\n";
constexpr const char* kEndOfHeader = "end_header\n";
constexpr std::size_t kBytesPerPoint = 3 * 8 + 5 * 4 + 2 * 2;
constexpr const char* kComment = "comment fringecal point cloud: mm, frame world; u_mm along the camera's ray, k = 1\n";

template <class T>
char* put(char* at, T value) {
  std::memcpy(at, &value, sizeof value);
  return at + sizeof value;
}

template <class T>
T take(const char*& at) {
  T value;
  std::memcpy(&value, at, sizeof value);
  at += sizeof value;
  return value;
}

}  // namespace

std::vector<Eigen::Vector3d> PointCloud::positions_mm() const {
  std::vector<Eigen::Vector3d> out;
  out.reserve(points.size());
  for (const auto& point : points) out.push_back(point.position_mm);
  return out;
}

CloudSummary summary_of(const PointCloud& cloud) {
  require(!cloud.points.empty(), "a summary needs a point");
  CloudSummary summary{.min_mm = cloud.points.front().position_mm, .max_mm = cloud.points.front().position_mm};
  std::vector<double> u;
  u.reserve(cloud.points.size());
  for (const auto& point : cloud.points) {
    summary.min_mm = summary.min_mm.cwiseMin(point.position_mm);
    summary.max_mm = summary.max_mm.cwiseMax(point.position_mm);
    u.push_back(point.u_along_ray_mm);
  }
  const auto middle = u.begin() + static_cast<std::ptrdiff_t>(u.size() / 2);
  std::nth_element(u.begin(), middle, u.end());
  summary.median_u_along_ray_mm = *middle;
  return summary;
}

void write_ply(const std::filesystem::path& file, const PointCloud& cloud, std::span<const float> deviation_mm) {
  require(deviation_mm.empty() || deviation_mm.size() == cloud.points.size(), "each point has its deviation");
  std::string bytes =
      fmt::format("ply\nformat binary_little_endian 1.0\n{}element vertex {}\n{}{}{}", kComment, cloud.points.size(),
                  kProperties, deviation_mm.empty() ? "" : kDeviation, kEndOfHeader);
  const std::size_t header = bytes.size();
  bytes.resize(header + cloud.points.size() * (kBytesPerPoint + (deviation_mm.empty() ? 0 : sizeof(float))));
  char* at = bytes.data() + header;
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const CloudPoint& p = cloud.points[i];
    for (int k = 0; k < 3; ++k) at = put(at, p.position_mm[k]);
    for (int k = 0; k < 3; ++k) at = put(at, static_cast<float>(p.normal[k]));
    at = put(at, static_cast<float>(p.u_along_ray_mm));
    at = put(at, p.modulation);
    at = put(at, p.pixel_x);
    at = put(at, p.pixel_y);
    if (!deviation_mm.empty()) at = put(at, deviation_mm[i]);
  }
  write_atomically(file, bytes);
}

PointCloud read_ply(const std::filesystem::path& file) {
  const std::string bytes = read_bytes(file);
  const auto refuse = [&](const std::string& what) {
    return InputError(fmt::format("{}: {}; give a point cloud written by 'fringecal measure'", file.string(), what));
  };
  const std::string start = fmt::format("ply\nformat binary_little_endian 1.0\n{}element vertex ", kComment);
  if (!bytes.starts_with(start)) throw refuse("not a point cloud of this program");
  std::size_t at = start.size(), count = 0, digits = 0;
  for (; at < bytes.size() && bytes[at] >= '0' && bytes[at] <= '9' && digits < 12; ++at, ++digits) {
    count = 10 * count + static_cast<std::size_t>(bytes[at] - '0');
  }
  const std::string properties = std::string("\n") + kProperties;
  if (digits == 0 || bytes.compare(at, properties.size(), properties) != 0)
    throw refuse("its header is not as expected");
  at += properties.size();
  const bool with_deviation = std::string_view(bytes).substr(at).starts_with(kDeviation);
  if (with_deviation) at += std::strlen(kDeviation);
  if (!std::string_view(bytes).substr(at).starts_with(kEndOfHeader)) throw refuse("its header is not as expected");
  at += std::strlen(kEndOfHeader);
  const std::size_t per_point = kBytesPerPoint + (with_deviation ? sizeof(float) : 0);
  if (bytes.size() - at != count * per_point) {
    throw refuse(
        fmt::format("{} points need {} bytes, the file holds {}", count, count * per_point, bytes.size() - at));
  }
  PointCloud cloud;
  cloud.points.resize(count);
  const char* from = bytes.data() + at;
  for (auto& p : cloud.points) {
    for (int i = 0; i < 3; ++i) p.position_mm[i] = take<double>(from);
    for (int i = 0; i < 3; ++i) p.normal[i] = take<float>(from);
    p.u_along_ray_mm = take<float>(from);
    p.modulation = take<float>(from);
    p.pixel_x = take<std::uint16_t>(from);
    p.pixel_y = take<std::uint16_t>(from);
    if (with_deviation) take<float>(from);
  }
  return cloud;
}

}  // namespace fringecal::metrology
