// Maps of the deviations of fitted features.
#include "core/image_file.h"
#include "reports/certificate_figures.h"
#include "reports/number.h"
#include "reports/svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace fringecal::reports {
namespace {

constexpr int kCells = 72;  // of the longer side: 2 px each in the figure
constexpr double kTile = 144, kTileFoot = 32, kTiles = 4, kWidth = 640, kTop = 4;
constexpr std::size_t kMost = 8;  // maps on a certificate; all clouds are in data.zip

struct Map {
  std::string artefact, capture;
  int part = 0;
  double range_mm = 0;  // 0.5 % to 99.5 % of the deviations
  metrology::ResidualCloud cloud;
};

/// The 99.5 % quantile minus the 0.5 % quantile of the points that were kept; nothing below 100 points.
std::optional<double> range_of(const metrology::ResidualCloud& cloud) {
  std::vector<float> d;
  for (const auto& p : cloud) {
    if (!p.rejected) d.push_back(p.deviation_mm);
  }
  if (d.size() < 100) return std::nullopt;
  std::sort(d.begin(), d.end());
  const auto at = [&](double q) { return d[static_cast<std::size_t>(q * static_cast<double>(d.size() - 1))]; };
  return at(0.995) - at(0.005);
}

/// Of each artefact and part the feature with the largest range.
std::vector<Map> maps_of(const Record& record) {
  std::vector<Map> out;
  for (const auto& f : record.verification.features) {
    const auto file = std::find_if(record.clouds.begin(), record.clouds.end(),
                                   [&](const ArchiveFile& one) { return one.name == f.cloud; });
    if (f.cloud.empty() || file == record.clouds.end()) continue;
    auto cloud = metrology::residual_cloud_from(file->bytes, f.cloud);
    const auto range = range_of(cloud);
    if (!range) continue;
    const auto same = std::find_if(out.begin(), out.end(),
                                   [&](const Map& m) { return m.artefact == f.artefact && m.part == f.part; });
    if (same == out.end()) {
      out.push_back({f.artefact, f.capture, f.part, *range, std::move(cloud)});
    } else if (*range > same->range_mm) {
      *same = {f.artefact, f.capture, f.part, *range, std::move(cloud)};
    }
  }
  if (out.size() > kMost) out.resize(kMost);
  return out;
}

/// Mean deviation of each square of X and Y as a level of grey: 40 at -limit, 250 at +limit, white paper elsewhere.
std::string png_of(const metrology::ResidualCloud& cloud, double limit_mm, int& width, int& height) {
  Eigen::Vector2f low = cloud.front().position_mm.head<2>(), high = low;
  for (const auto& p : cloud) {
    low = low.cwiseMin(p.position_mm.head<2>());
    high = high.cwiseMax(p.position_mm.head<2>());
  }
  const float cell = std::max((high - low).maxCoeff(), 1e-6f) / kCells;
  width = std::clamp(static_cast<int>((high.x() - low.x()) / cell) + 1, 1, kCells + 1);
  height = std::clamp(static_cast<int>((high.y() - low.y()) / cell) + 1, 1, kCells + 1);
  std::vector<double> sum(static_cast<std::size_t>(width * height)), n(sum.size());
  for (const auto& p : cloud) {
    if (p.rejected) continue;
    const int x = std::min(static_cast<int>((p.position_mm.x() - low.x()) / cell), width - 1);
    const int y = std::min(static_cast<int>((p.position_mm.y() - low.y()) / cell), height - 1);
    const auto i = static_cast<std::size_t>((height - 1 - y) * width + x);  // Y upwards
    sum[i] += p.deviation_mm;
    n[i] += 1;
  }
  Image<Rgb> image(width, height, Rgb{255, 255, 255});
  for (std::size_t i = 0; i < sum.size(); ++i) {
    if (n[i] == 0) continue;
    const double t = std::clamp(0.5 + 0.5 * sum[i] / n[i] / limit_mm, 0.0, 1.0);
    const auto grey = static_cast<std::uint8_t>(std::lround(40 + 210 * t));
    image.values()[i] = {grey, grey, grey};
  }
  return encode_png(image);
}

std::string image_svg(const std::string& png, double x, double y, double width, double height) {
  return fmt::format(
      "<image x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" "
      "style=\"image-rendering:pixelated\" xlink:href=\"data:image/png;base64,{}\"/>",
      x, y, width, height, base64(png));
}

/// The scale of greys with its ends.
std::string scale_svg(double y, const std::string& limit) {
  constexpr int kSteps = 21;
  constexpr double kLeft = 240, kStep = 8;
  std::string out = svg::words(kLeft - 6, y + 9, "end", "\u2212" + limit + "\u00a0µm") +
                    svg::words(kLeft + kSteps * kStep + 6, y + 9, "start", "+" + limit + "\u00a0µm");
  for (int k = 0; k < kSteps; ++k) {
    const int grey = 40 + 210 * k / (kSteps - 1);
    out += svg::box(kLeft + kStep * k, y, kStep + 0.3, 11, fmt::format("rgb({0},{0},{0})", grey).c_str());
  }
  return out + svg::box(kLeft, y, kSteps * kStep, 11, "none", svg::kInk, 0.6);
}

}  // namespace

std::vector<CertificateFigure> map_figures(const Certificate& c, const Catalogue& words) {
  std::vector<CertificateFigure> out;
  for (const auto& record : c.records) {
    const auto maps = maps_of(record);
    if (maps.empty()) continue;
    double limit_um = 0;
    for (const auto& map : maps) limit_um = std::max(limit_um, 500 * map.range_mm);
    limit_um = std::max(1.0, std::ceil(limit_um));
    const std::string limit = fixed(limit_um, 0);
    const double rows = std::ceil(static_cast<double>(maps.size()) / kTiles);
    const double height = kTop + rows * (kTile + kTileFoot) + 26;
    std::string drawing = svg::begin("maps", kWidth, height);
    std::string numbers = fmt::format("-{0} µm +{0} µm", limit);
    for (std::size_t k = 0; k < maps.size(); ++k) {
      const std::size_t row = k / 4;
      const double left = static_cast<double>(k % 4) * (kWidth / kTiles),
                   top = kTop + static_cast<double>(row) * (kTile + kTileFoot);
      int width = 0, rows_of_cells = 0;
      const std::string png = png_of(maps[k].cloud, 1e-3 * limit_um, width, rows_of_cells);
      const double px = kTile / (kCells + 1);
      drawing += image_svg(png, left, top + kTile - px * rows_of_cells, px * width, px * rows_of_cells);
      std::string name = maps[k].artefact;
      if (maps[k].part > 0) name += fmt::format(", {}", static_cast<char>('A' + maps[k].part));
      drawing += svg::words(left, top + kTile + 13, "start", name, 9.5) +
                 svg::words(left, top + kTile + 25, "start", maps[k].capture, 8.5);
      numbers += " " + name + " " + maps[k].capture;
    }
    drawing += scale_svg(height - 18, limit);
    out.push_back({"maps", Markup::trusted(drawing + svg::kEnd), words("figures.maps"), numbers});
  }
  return out;
}

}  // namespace fringecal::reports
