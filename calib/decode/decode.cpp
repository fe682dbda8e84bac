#include "calib/decode/decode.h"

#include "calib/decode/four_step.h"
#include "calib/decode/gray.h"
#include "calib/decode/noise.h"
#include "calib/decode/phase.h"
#include "core/parallel.h"

#include <cmath>
#include <limits>

namespace fringecal::decode {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Limits and noise, the same for all pixels of a capture, in grey levels.
struct Levels {
  float saturation = 0, least_modulation = 0;
  // B of pure noise is Rayleigh-distributed with the parameter sigma sqrt(2 / N); 3.7 of these are exceeded once in a
  // thousand. White minus black of no light has the deviation sqrt(2) sigma; 3.1 of these likewise.
  float shadow_modulation_per_sigma = 0;
  float shadow_difference_per_sigma = 3.1f * std::numbers::sqrt2_v<float>;
  float read_variance = 0, gain = 0, u_per_sigma_over_b = 0;

  Levels(const Capture& capture, const AxisFrames& frames, const DecodeOptions& options, const NoiseModel& noise)
      : saturation(static_cast<float>(capture.saturation_level())),
        least_modulation(static_cast<float>(options.min_modulation_8bit * (capture.saturation_level() + 1) / 256.0)),
        read_variance(static_cast<float>(noise.read_variance)),
        gain(static_cast<float>(noise.gain)) {
    const double steps = static_cast<double>(std::max<std::size_t>(1, frames.phase.size()));
    shadow_modulation_per_sigma = static_cast<float>(3.7 * std::sqrt(2.0 / steps));
    u_per_sigma_over_b = static_cast<float>(std::sqrt(2.0 / steps));
  }
  /// NoiseModel::sigma in single precision.
  float sigma(float level) const { return std::sqrt(std::max(1.0f / 12.0f, read_variance + gain * level)); }
};

class Decoder {
 public:
  Decoder(const Capture& capture, const AxisFrames& frames, const Levels& levels, PhaseMap& map)
      : capture_(capture), frames_(frames), map_(map), levels_(levels) {
    if (!frames.phase.empty()) steps_.emplace(static_cast<int>(frames.phase.size()));
    periods_ = frames.code.stripes() / frames.code.stripes_per_period;
  }

  /// Everything that one thread needs for a row.
  struct Buffers {
    Buffers(std::size_t width, const AxisFrames& frames)
        : phase_frames(frames.phase.size(), std::vector<float>(width)),
          phase(width),
          bits(width, frames.gray.size()),
          white(width),
          black(width),
          other(width) {}
    std::vector<std::vector<float>> phase_frames;
    PhaseRow phase;
    BitRow bits;
    std::vector<float> white, black, other;
  };

  void decode_row(int y, Buffers& b) const {
    if (frames_.has_white_and_black()) {
      load_row(capture_.frames[*frames_.white], y, b.white);
      load_row(capture_.frames[*frames_.black], y, b.black);
    }
    if (steps_) {
      for (std::size_t k = 0; k < frames_.phase.size(); ++k)
        load_row(capture_.frames[frames_.phase[k]], y, b.phase_frames[k]);
      steps_->evaluate(b.phase_frames, b.phase);
    }
    for (std::size_t bit = 0; bit < frames_.gray.size(); ++bit) load_bit(y, bit, b);
    if (steps_) {
      finish_with_phase(y, b);
    } else {
      finish_with_stripes(y, b);
    }
  }

 private:
  /// t_b of eq. 1 of gray.h.
  void load_bit(int y, std::size_t bit, Buffers& b) const {
    const std::size_t width = b.bits.width;
    const std::span<float> t(b.bits.t.data() + bit * width, width);
    load_row(capture_.frames[frames_.gray[bit]], y, t);
    switch (frames_.reference_of(bit)) {
      case BitReference::inverse:
        load_row(capture_.frames[*frames_.inverse[bit]], y, b.other);
        for (std::size_t x = 0; x < width; ++x) t[x] = 0.5f * (t[x] - b.other[x]);
        break;
      case BitReference::phase_mean:
        for (std::size_t x = 0; x < width; ++x) t[x] -= b.phase.mean[x];
        break;
      case BitReference::white_and_black:
        for (std::size_t x = 0; x < width; ++x) t[x] -= 0.5f * (b.white[x] + b.black[x]);
        break;
    }
    append_bit(b.bits, bit);
  }

  bool without_light(float white, float black, float modulation, float sigma) const {
    return frames_.has_white_and_black() ? !(white - black > levels_.shadow_difference_per_sigma * sigma)
                                         : !(modulation > levels_.shadow_modulation_per_sigma * sigma);
  }

  void finish_with_phase(int y, const Buffers& b) const {
    const std::size_t row = map_.validity.index(0, y);
    const int bits = frames_.code.gray_bits;
    const int per_period = frames_.code.stripes_per_period;
    const bool redundant = map_.edges == EdgeRule::redundant;
    constexpr float kTurn = 2 * std::numbers::pi_v<float>;
    for (std::size_t x = 0; x < b.bits.width; ++x) {
      const float wrapped = b.phase.wrapped[x], modulation = b.phase.modulation[x], mean = b.phase.mean[x];
      const float sigma = levels_.sigma(mean);
      Validity validity = Validity::valid;
      FringeNumber fringe;
      if (b.phase.brightest[x] >= levels_.saturation) {
        validity = Validity::saturated;
      } else if (without_light(b.white[x], b.black[x], modulation, sigma)) {
        validity = Validity::shadow;
      } else if (!(modulation >= levels_.least_modulation)) {
        validity = Validity::low_modulation;
      } else if (bits > 0) {
        const std::int32_t stripe = b.bits.stripe[x];
        if (!redundant) {
          fringe.m = stripe / per_period;
        } else if (per_period == 2) {
          fringe = fringe_of_half_stripe(stripe, wrapped, periods_);
        } else {
          fringe = fringe_of_whole_stripe(b.bits, x, bits,
                                          {wrapped, levels_.u_per_sigma_over_b * sigma / modulation, sigma});
        }
        if (redundant && undecided_far_from_edges(b.bits, x, bits, sigma)) fringe.consistent = false;
        if (!fringe.consistent) validity = Validity::inconsistent_code;
      }
      const std::size_t i = row + x;
      const bool valid = validity == Validity::valid;
      map_.validity.values()[i] = static_cast<std::uint8_t>(validity);
      map_.wrapped_rad.values()[i] = wrapped;
      map_.modulation.values()[i] = modulation;
      map_.mean.values()[i] = mean;
      map_.phase_rad.values()[i] = valid ? kTurn * static_cast<float>(fringe.m) + wrapped : kNan;     // (3)
      map_.u_phase_rad.values()[i] = valid ? levels_.u_per_sigma_over_b * sigma / modulation : kNan;  // (4)
    }
  }

  void finish_with_stripes(int y, const Buffers& b) const {
    const std::size_t row = map_.validity.index(0, y), bits = frames_.gray.size(), width = b.bits.width;
    const bool redundant = map_.edges == EdgeRule::redundant;
    const auto u_stripe = static_cast<float>(2 * std::numbers::pi / frames_.code.stripes_per_period / std::sqrt(12.0));
    for (std::size_t x = 0; x < width; ++x) {
      float modulation = 0, mean = 0;
      if (frames_.has_white_and_black()) {
        modulation = 0.5f * (b.white[x] - b.black[x]);
        mean = 0.5f * (b.white[x] + b.black[x]);
      } else {
        for (std::size_t bit = 0; bit < bits; ++bit) modulation += std::abs(b.bits.t[bit * width + x]);
        modulation /= static_cast<float>(bits);
        mean = modulation;
      }
      modulation = std::max(0.0f, modulation);
      const float sigma = levels_.sigma(mean);
      Validity validity = Validity::valid;
      if (frames_.has_white_and_black() && b.white[x] >= levels_.saturation) {
        validity = Validity::saturated;
      } else if (without_light(b.white[x], b.black[x], modulation, sigma)) {
        validity = Validity::shadow;
      } else if (!(modulation >= levels_.least_modulation)) {
        validity = Validity::low_modulation;
      } else if (redundant && undecided_far_from_edges(b.bits, x, static_cast<int>(bits), sigma)) {
        validity = Validity::inconsistent_code;
      }
      const std::size_t i = row + x;
      const bool valid = validity == Validity::valid;
      const double u = (b.bits.stripe[x] + 0.5) * frames_.code.stripe_width();  // (5)
      map_.validity.values()[i] = static_cast<std::uint8_t>(validity);
      map_.modulation.values()[i] = modulation;
      map_.mean.values()[i] = mean;
      map_.phase_rad.values()[i] = valid ? static_cast<float>(frames_.code.phase_from_u(u)) : kNan;
      map_.u_phase_rad.values()[i] = valid ? u_stripe : kNan;
    }
  }

  const Capture& capture_;
  const AxisFrames& frames_;
  PhaseMap& map_;
  const Levels& levels_;
  std::optional<PhaseSteps> steps_;
  std::int32_t periods_ = 0;
};

/// The capture as the pass of four_step.h takes it; empty where it does not fit.
std::optional<FourStepTask> four_step_task(const Capture& capture, const AxisFrames& frames, const Levels& levels,
                                           PhaseMap& map) {
  FourStepTask task;
  const std::size_t bits = frames.gray.size();
  if (frames.phase.size() != 4 || bits == 0 || bits > FourStepTask::kMostBits || frames.has_white_and_black())
    return {};
  const std::size_t depth = capture.frames[frames.phase[0]].index();
  const auto place = [&](std::size_t frame, const void*& to) {
    const GrayImage& image = capture.frames[frame];
    to = std::visit([](const auto& i) { return static_cast<const void*>(i.data()); }, image);
    return image.index() == depth;
  };
  for (std::size_t k = 0; k < 4; ++k) {
    if (!place(frames.phase[k], task.phase[k])) return {};
  }
  for (std::size_t b = 0; b < bits; ++b) {
    if (frames.reference_of(b) != BitReference::phase_mean || !place(frames.gray[b], task.gray[b])) return {};
  }
  task.wide = std::holds_alternative<Image16>(capture.frames[frames.phase[0]]);
  task.bits = static_cast<int>(bits);
  task.stripes_per_period = frames.code.stripes_per_period;
  task.rule = map.edges == EdgeRule::plain          ? OrderRule::plain
              : frames.code.stripes_per_period == 2 ? OrderRule::half_stripe
                                                    : OrderRule::whole_stripe;
  task.read_variance = levels.read_variance;
  task.gain = levels.gain;
  task.saturation = levels.saturation;
  task.min_modulation = levels.least_modulation;
  task.shadow_modulation_per_sigma = levels.shadow_modulation_per_sigma;
  const auto wanted = [](Image<float>& image) { return image.empty() ? nullptr : image.data(); };
  task.phase_rad = map.phase_rad.data();
  task.validity = map.validity.data();
  task.wrapped_rad = wanted(map.wrapped_rad);
  task.modulation = wanted(map.modulation);
  task.mean = wanted(map.mean);
  task.u_phase_rad = wanted(map.u_phase_rad);
  return task;
}

/// An image of that size, in the memory of `image` where it has it.
template <class T>
void reshape(Image<T>& image, int width, int height) {
  if (image.width() != width || image.height() != height) image = Image<T>(width, height);
}

}  // namespace

const char* name_of(Validity validity) {
  switch (validity) {
    case Validity::valid:
      return "valid";
    case Validity::shadow:
      return "shadow";
    case Validity::saturated:
      return "saturated";
    case Validity::low_modulation:
      return "low modulation";
    case Validity::inconsistent_code:
      return "inconsistent code";
  }
  return "";
}

std::array<std::size_t, 5> count_validity(const PhaseMap& map) {
  std::array<std::size_t, 5> out{};
  for (const std::uint8_t v : map.validity.values()) ++out[v];
  return out;
}

DecodeSummary summary_of(const PhaseMap& map) {
  DecodeSummary out;
  out.counts = count_validity(map);
  const auto median = [&](const Image<float>& image) -> std::optional<double> {
    std::vector<float> values;
    for (std::size_t i = 0; i < image.size(); ++i) {
      if (map.validity.values()[i] == 0) values.push_back(image.values()[i]);
    }
    if (values.empty()) return std::nullopt;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  out.median_u_phase_rad = median(map.u_phase_rad);
  if (out.median_u_phase_rad) out.median_u_pattern = *out.median_u_phase_rad * map.code.period / (2 * std::numbers::pi);
  out.median_modulation = median(map.modulation);
  double sum = 0;
  for (const float a : map.mean.values()) sum += a;
  if (!map.mean.empty()) out.mean_level = sum / static_cast<double>(map.mean.size());
  return out;
}

PhaseMap decode_phase(const Capture& capture, CodeAxis axis, const DecodeOptions& options, PhaseMap reused) {
  const AxisFrames frames = frames_of(capture, axis);
  const int width = capture.info.width_px, height = capture.info.height_px;
  PhaseMap map = std::move(reused);
  map.axis = axis;
  map.code = frames.code;
  map.edges = options.edges;
  if (options.sigma_gray_levels) {
    const double sigma = *options.sigma_gray_levels;
    map.noise = {.read_variance = sigma * sigma, .gain = 0, .source = "given"};
  } else {
    map.noise = estimate_noise(capture, frames);
  }
  const Levels levels(capture, frames, options, map.noise);
  const auto shape = [&](Image<float>& image, bool wanted) { reshape(image, wanted ? width : 0, wanted ? height : 0); };
  reshape(map.validity, width, height);
  shape(map.phase_rad, true);
  const auto shape_optional = [&](Detail detail) {
    shape(map.wrapped_rad, detail == Detail::all && !frames.phase.empty());
    shape(map.modulation, detail != Detail::phase);
    shape(map.mean, detail == Detail::all);
    shape(map.u_phase_rad, detail != Detail::phase);
  };
  shape_optional(options.detail);
  if (const auto task = four_step_task(capture, frames, levels, map)) {
    constexpr std::size_t kChunk = 32768;  // pixels per call
    const std::size_t pixels = map.validity.size();
    parallel_for(static_cast<int>((pixels + kChunk - 1) / kChunk), [&](int chunk) {
      const std::size_t first = static_cast<std::size_t>(chunk) * kChunk;
      decode_four_step(*task, first, std::min(kChunk, pixels - first));
    });
    return map;
  }
  shape_optional(Detail::all);
  const Decoder decoder(capture, frames, levels, map);
  constexpr int kBand = 16;  // rows per call: the buffers are made once for them
  parallel_for((height + kBand - 1) / kBand, [&](int band) {
    Decoder::Buffers buffers(static_cast<std::size_t>(width), frames);
    for (int y = band * kBand; y < std::min(height, (band + 1) * kBand); ++y) decoder.decode_row(y, buffers);
  });
  shape_optional(options.detail);
  return map;
}

}  // namespace fringecal::decode
