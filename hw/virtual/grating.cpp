#include "hw/virtual/grating.h"

#include <algorithm>
#include <array>
#include <numbers>

namespace fringecal::virt {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kTableSize = 2048;
constexpr float kTableReach = 6.0F;  // Phi(-6) = 1e-9

const std::array<float, kTableSize + 2>& phi_table() {
  static const auto table = [] {
    std::array<float, kTableSize + 2> out;
    for (int i = 0; i < kTableSize + 2; ++i) {
      out[static_cast<std::size_t>(i)] =
          static_cast<float>(normal_cdf(2.0 * kTableReach * i / kTableSize - kTableReach));
    }
    return out;
  }();
  return table;
}

inline float phi(const float* table, float x) {
  const float place = (std::clamp(x, -kTableReach, kTableReach) + kTableReach) * (kTableSize / (2.0F * kTableReach));
  const int i = static_cast<int>(place);
  return table[i] + (place - static_cast<float>(i)) * (table[i + 1] - table[i]);
}

}  // namespace

Grating::Grating(const Preset& preset)
    : code_(preset.grating.code),
      dark_(1.0 / preset.grating.contrast),
      h_centre_(preset.grating.third_harmonic_centre),
      h_edge_(preset.grating.third_harmonic_edge) {}

double Grating::sigma_mm(double rho2) const {
  const double h = std::clamp(h_centre_ + (h_edge_ - h_centre_) * rho2, 1e-6, 0.1);
  return code_.period / (2.0 * kPi) * std::sqrt(-0.25 * std::log(3.0 * h));  // eq. 3
}

double Grating::first_harmonic(double sigma_mm) const {
  const double x = 2.0 * kPi * sigma_mm / code_.period;
  return std::exp(-0.5 * x * x);
}

double Grating::modulation_at_centre() const { return (1.0 - dark_) * 2.0 / kPi * first_harmonic(sigma_mm(0.0)); }

void Grating::project_phase(int step, double offset_mm, const LightRow& row, std::span<float> transmission) const {
  const double shift = 2.0 * kPi * (static_cast<double>(step) / code_.phase_steps + offset_mm / code_.period);
  const auto cos_shift = static_cast<float>(std::cos(shift)), sin_shift = static_cast<float>(std::sin(shift));
  const auto two_over_pi = static_cast<float>(2.0 / kPi);
  const float *cosine = row.cosine.data(), *sine = row.sine.data(), *e1 = row.first_harmonic.data();
  float* out = transmission.data();
  for (std::size_t i = 0; i < transmission.size(); ++i) {
    const float c = cosine[i] * cos_shift + sine[i] * sin_shift, c2 = c * c;
    const float e2 = e1[i] * e1[i], e4 = e2 * e2, e8 = e4 * e4, e9 = e8 * e1[i], e25 = e9 * e8 * e8;
    const float third = c * (4.0F * c2 - 3.0F), fifth = c * (16.0F * c2 * c2 - 20.0F * c2 + 5.0F);
    out[i] = 0.5F + two_over_pi * (e1[i] * c - (1.0F / 3.0F) * e9 * third + 0.2F * e25 * fifth);  // eq. 4
  }
}

void Grating::project_gray(int bit, double offset_mm, const LightRow& row, std::span<float> transmission) const {
  const double width = code_.stripe_width() * std::exp2(code_.gray_bits - 1 - bit);
  // u / 4W shifted by whole periods to stay positive, so that truncation is floor.
  const auto scale = static_cast<float>(1.0 / (4.0 * width)),
             start = static_cast<float>(8.0 - offset_mm / (4.0 * width));
  const auto w = static_cast<float>(width), shift = static_cast<float>(offset_mm);
  const float* table = phi_table().data();
  const float *u = row.u_mm.data(), *inverse_sigma = row.inverse_sigma.data();
  float* out = transmission.data();
  for (std::size_t i = 0; i < transmission.size(); ++i) {
    const float turns = u[i] * scale + start;
    const float whole = static_cast<float>(static_cast<int>(turns)) - 8.0F;
    const float from_middle = std::abs((u[i] - shift) - (whole * 4.0F + 2.0F) * w);  // of the bright stripe, 0 .. 2W
    const float s = inverse_sigma[i];
    out[i] = phi(table, (w - from_middle) * s) + phi(table, (w + from_middle) * s) -
             phi(table, (3.0F * w - from_middle) * s);  // eq. 5: the near edge, the far edge, the next stripe
  }
  for (float& t : transmission) t = std::max(t, 0.0F);
}

void Grating::project(const Pattern& pattern, double offset_mm, const LightRow& row, const Shine& shine,
                      std::span<float> out) const {
  if (pattern.kind == PatternKind::phase) {
    project_phase(pattern.index, offset_mm, row, out);
  } else {
    project_gray(pattern.index, offset_mm, row, out);
  }
  const auto offset = static_cast<float>(shine.base), gain = static_cast<float>(shine.factor);
  const double clear = 1.0 - shine.veil;
  const auto dark = static_cast<float>(dark_ + 0.5 * (1.0 - dark_) * shine.veil),
             range = static_cast<float>((1.0 - dark_) * clear);
  const float* light = row.light.data();
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = offset + gain * light[i] * (dark + range * out[i]);
}

}  // namespace fringecal::virt
