#include "calib/decode/stack_errors.h"

#include "calib/decode/modulation_ripple.h"
#include "calib/decode/rows.h"
#include "core/parallel.h"

#include <cmath>

namespace fringecal::decode {
namespace {

/// ln D for each pixel of an image row; NaN-free: usable says where it is known.
struct LightRow {
  std::vector<double> log_light;
  std::vector<char> usable;
};

/// White minus black of the Gray frames that are far from their edges at a pixel.
class Light {
 public:
  Light(const Capture& capture, const PhaseMap& map, const AxisFrames& frames) : map_(map) {
    for (std::size_t b = 0; b < frames.gray.size(); ++b) {
      const double spacing =
          std::ldexp(1.0, map.code.gray_bits - 1 - static_cast<int>(b)) / map.code.stripes_per_period;
      if (spacing > kClear) bits_.push_back({&capture.frames[frames.gray[b]], spacing});
    }
    if (bits_.size() < 2) bits_.clear();
  }

  void load(int y, LightRow& out, std::vector<std::vector<float>>& buffers) const {
    const auto width = static_cast<std::size_t>(map_.width());
    out.log_light.assign(width, 0.0);
    out.usable.assign(width, 1);
    if (bits_.empty()) return;
    buffers.resize(bits_.size(), std::vector<float>(width));
    for (std::size_t b = 0; b < bits_.size(); ++b) load_row(*bits_[b].frame, y, buffers[b]);
    for (std::size_t x = 0; x < width; ++x) {
      const int column = static_cast<int>(x);
      out.usable[x] = map_.valid(column, y);
      if (!out.usable[x]) continue;
      const double periods = map_.phase_rad(column, y) / (2 * std::numbers::pi) + 0.5, level = map_.mean(column, y);
      double white = 0, black = 0;
      int n_white = 0, n_black = 0;
      for (std::size_t b = 0; b < bits_.size(); ++b) {
        // Edges stand at odd multiples of the spacing.
        const double edges = (periods - bits_[b].spacing) / (2 * bits_[b].spacing);
        const double from_edge = 2 * bits_[b].spacing * std::abs(edges - std::floor(edges + 0.5));
        if (from_edge < kClear) continue;
        const double value = buffers[b][x];
        (value > level ? white : black) += value;
        ++(value > level ? n_white : n_black);
      }
      const double light = n_white > 0 && n_black > 0 ? white / n_white - black / n_black : 0.0;
      out.usable[x] = light > map_.modulation(column, y);
      if (out.usable[x]) out.log_light[x] = std::log(light);
    }
  }

 private:
  struct Bit {
    const GrayImage* frame;
    double spacing;  // from u = 0 to the first edge, periods
  };
  const PhaseMap& map_;
  std::vector<Bit> bits_;
};

}  // namespace

Result<StackErrors> estimate_stack_errors(const Capture& capture, const PhaseMap& map) {
  const AxisFrames frames = frames_of(capture, map.axis);
  require(!frames.phase.empty(), "stack errors are those of phase patterns");
  const Light light(capture, map, frames);
  ModulationMap modulation{.axis = map.axis,
                           .phase_steps = map.code.phase_steps,
                           .log_ratio = Image<float>(map.width(), map.height()),
                           .phase_rad = map.phase_rad,
                           .wrapped_rad = map.wrapped_rad,
                           .usable = Image<std::uint8_t>(map.width(), map.height())};
  const int stride = line_stride(count_validity(map)[0]);
  parallel_for(map.height(), [&](int y) {
    if (map.axis == CodeAxis::x && y % stride != 0) return;
    LightRow row;
    std::vector<std::vector<float>> buffers;
    light.load(y, row, buffers);
    for (int x = 0; x < map.width(); ++x) {
      if (!map.valid(x, y) || !row.usable[x] || (map.axis == CodeAxis::y && x % stride != 0)) continue;
      modulation.usable(x, y) = 1;
      modulation.log_ratio(x, y) = static_cast<float>(std::log(map.modulation(x, y)) - row.log_light[x]);
    }
  });
  return fit_modulation_ripple(modulation);
}

}  // namespace fringecal::decode
