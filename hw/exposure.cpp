#include "hw/exposure.h"

#include "core/parallel.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace fringecal::hw {
namespace {

constexpr double kIgnoredPart = 1e-4, kBand = 0.07, kMostFactor = 8, kSaturatedFactor = 0.25;

struct Step {
  std::size_t frame;
  std::complex<double> weight;
};

/// The phase steps of one code with the weights of (2).
std::vector<Step> steps_of(const PatternPlan& plan, CodeAxis axis) {
  std::vector<Step> steps;
  const auto& code = plan.code(axis);
  if (!code) return steps;
  for (std::size_t k = 0; k < plan.patterns.size(); ++k) {
    const Pattern& p = plan.patterns[k];
    if (p.kind != PatternKind::phase || p.axis != axis) continue;
    steps.push_back({k, std::polar(2.0 / code->phase_steps, 2 * std::numbers::pi * p.index / code->phase_steps)});
  }
  return steps;
}

template <class T>
double modulation(const std::vector<const Image<T>*>& frames, const std::vector<std::vector<Step>>& codes,
                  std::size_t pixel) {
  double sum = 0;
  bool any = false;
  for (const auto& steps : codes) {
    if (steps.empty()) continue;
    std::complex<double> amplitude;
    for (const Step& s : steps) amplitude += s.weight * static_cast<double>(frames[s.frame]->values()[pixel]);  // (2)
    sum += std::abs(amplitude);
    any = true;
  }
  if (any) return sum;
  T least = frames[0]->values()[pixel], most = least;
  for (const auto* frame : frames) {
    least = std::min(least, frame->values()[pixel]);
    most = std::max(most, frame->values()[pixel]);
  }
  return static_cast<double>(most) - static_cast<double>(least);
}

template <class T>
std::vector<GrayImage> merge(const PatternPlan& plan, const std::vector<std::vector<GrayImage>>& stacks,
                             int saturation_level) {
  std::vector<std::vector<const Image<T>*>> in;
  for (const auto& stack : stacks) {
    auto& frames = in.emplace_back();
    for (const GrayImage& image : stack) {
      require(std::holds_alternative<Image<T>>(image), "all frames of a merge have one depth");
      frames.push_back(&std::get<Image<T>>(image));
      require(frames.back()->size() == in[0][0]->size(), "all frames of a merge have one size");
    }
  }
  std::vector<Image<T>> out(stacks[0].size(), Image<T>(in[0][0]->width(), in[0][0]->height()));
  const std::vector<std::vector<Step>> codes = {steps_of(plan, CodeAxis::x), steps_of(plan, CodeAxis::y)};
  parallel_for(in[0][0]->height(), [&](int y) {
    for (int x = 0; x < in[0][0]->width(); ++x) {
      const std::size_t pixel = in[0][0]->index(x, y);
      std::size_t best = 0;
      double best_modulation = -1;
      for (std::size_t e = 0; e < in.size(); ++e) {
        const bool saturated = std::any_of(in[e].begin(), in[e].end(),
                                           [&](const auto* f) { return f->values()[pixel] >= saturation_level; });
        if (saturated) continue;
        const double b = modulation(in[e], codes, pixel);
        if (b > best_modulation) {
          best = e;
          best_modulation = b;
        }
      }
      for (std::size_t k = 0; k < out.size(); ++k) out[k].values()[pixel] = in[best][k]->values()[pixel];
    }
  });
  return {std::make_move_iterator(out.begin()), std::make_move_iterator(out.end())};
}

}  // namespace

int bright_level(const GrayImage& frame) {
  return std::visit(
      [](const auto& image) {
        std::vector<std::size_t> count(65536, 0);
        for (const auto v : image.values()) ++count[v];
        const auto ignored = static_cast<std::size_t>(kIgnoredPart * static_cast<double>(image.size()));
        std::size_t above = 0;
        for (int level = 65535; level > 0; --level) {
          above += count[static_cast<std::size_t>(level)];
          if (above > ignored) return level;
        }
        return 0;
      },
      frame);
}

double saturated_part(const GrayImage& frame, int saturation_level) {
  return std::visit(
      [&](const auto& image) {
        const auto n =
            std::count_if(image.values().begin(), image.values().end(), [&](auto v) { return v >= saturation_level; });
        return image.empty() ? 0.0 : static_cast<double>(n) / static_cast<double>(image.size());
      },
      frame);
}

std::optional<double> next_exposure_ms(double exposure_ms, int level, int saturation_level,
                                       const ExposureSearch& search) {
  const double part = static_cast<double>(level) / saturation_level;
  if (std::abs(part - search.target) <= kBand) return std::nullopt;
  const double factor = level >= saturation_level ? kSaturatedFactor
                                                  : std::min(kMostFactor, search.target / std::max(part, 1e-3));  // (1)
  return std::clamp(exposure_ms * factor, search.least_ms, search.most_ms);
}

std::vector<GrayImage> merge_exposures(const PatternPlan& plan, const std::vector<std::vector<GrayImage>>& stacks,
                                       int saturation_level) {
  require(!stacks.empty() && !stacks[0].empty(), "a merge has frames");
  for (const auto& stack : stacks) {
    require(stack.size() == plan.patterns.size(), "every exposure of a merge has all frames of the plan");
  }
  if (std::holds_alternative<Image8>(stacks[0][0])) return merge<std::uint8_t>(plan, stacks, saturation_level);
  return merge<std::uint16_t>(plan, stacks, saturation_level);
}

}  // namespace fringecal::hw
