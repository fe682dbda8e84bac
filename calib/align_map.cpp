#include "calib/align_map.h"

#include "calib/align_edges.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fringecal::calib {

Image<float> delta_map_um(const Capture& capture, const Misalignment& measured, CodeAxis axis, int cell_px) {
  require(cell_px > 0 && !measured.bits.empty(), "a map has cells, and bits that were measured");
  const double period_um = 1e3 * capture.info.plan.code(axis)->period;
  const int columns = (capture.info.width_px + cell_px - 1) / cell_px;
  const int rows = (capture.info.height_px + cell_px - 1) / cell_px;
  std::vector<std::vector<float>> cells(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  const double finest = measured.bits.front().lever_mm;
  for (const auto& segment : find_edges(capture, axis).segments) {
    for (const GrayEdge& e : segment.edges) {
      const auto bit =
          std::find_if(measured.bits.begin(), measured.bits.end(), [&](const auto& b) { return b.bit == e.bit; });
      if (bit == measured.bits.end()) continue;
      const double expected = bit->fraction_of_period;
      const double asymmetry_um = 0.5e3 * (bit->rising_mm - bit->falling_mm) * (e.rising ? 1.0 : -1.0);
      const double delta_um = period_um * (expected + std::remainder(e.q_periods - expected, 1.0)) - asymmetry_um;
      const int along = static_cast<int>(std::lround(e.x_px));
      const int x = axis == CodeAxis::x ? along : segment.line, y = axis == CodeAxis::x ? segment.line : along;
      cells[static_cast<std::size_t>((y / cell_px) * columns + x / cell_px)].push_back(
          static_cast<float>(delta_um * finest / bit->lever_mm));  // (1)
    }
  }
  Image<float> out(columns, rows, std::numeric_limits<float>::quiet_NaN());
  for (std::size_t i = 0; i < cells.size(); ++i) {
    auto& cell = cells[i];
    if (cell.size() < static_cast<std::size_t>(kMinEdgesInCell)) continue;
    const auto middle = cell.begin() + static_cast<std::ptrdiff_t>(cell.size() / 2);
    std::nth_element(cell.begin(), middle, cell.end());
    out.values()[i] = *middle;
  }
  return out;
}

}  // namespace fringecal::calib
