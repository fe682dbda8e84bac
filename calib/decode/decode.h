// From the frames of a Capture to phase: Gray code and N-step phase shifting, with the standard uncertainty of each
// pixel.
//
//   wrapped     phi' = atan2(S, C),  S = sum I_k sin(2 pi k / N),  C = sum I_k cos(2 pi k / N)   (1)  [eq. 3 for N = 4]
//   modulation  B = (2 / N) sqrt(S^2 + C^2),   mean A = (1 / N) sum I_k                          (2)
//   absolute    phi = 2 pi m + phi',  m from the Gray code                                       (3)  [Chen2008, eq. 4]
//   noise       u(phi') = sqrt(2 / N) sigma / B, sigma the grey-level noise at that pixel        (4)
// A Gray bit is decided per pixel against the best reference that the plan has: its inverse; else the mean A of the
// phase patterns; else the mean of white and black. A plan without phase patterns gives phi at the middle of the stripe
// (5) with u(phi) = stripe / sqrt(12).
//
// Two results from the same frames (EdgeRule):
//   plain      m straight from the code: at a period edge the least error of the Gray edge shows as a jump of 2 pi. This
//              is what the grating alignment measures; it must not be hidden.
//   redundant  at a period edge the code's own redundancy decides which side of the edge a pixel is on: with two stripes
//              per period the half in which the code says the pixel lies; with one, the Gray bit nearest to its
//              threshold. For measuring. No neighbouring pixel is asked: each pixel stands alone.
#pragma once

#include "core/capture.h"
#include "core/image.h"
#include "core/result.h"

#include <array>
#include <cstdint>
#include <optional>
#include <string>

namespace fringecal::decode {

enum class Validity : std::uint8_t {
  valid = 0,
  // The projector's light does not arrive: white - black, or B where these are not in the plan, is not above the noise.
  shadow = 1,
  // A phase frame is at the camera's upper limit; without phase patterns, the white frame.
  saturated = 2,
  // B below the limit of the options.
  low_modulation = 3,
  // Redundant result only: code and phase contradict each other by more than the redundancy can explain, m is outside
  // of what the pattern holds, or a bit is undecided where it should not be (gray.h, eqs. 4, 6, 7).
  inconsistent_code = 4,
};

/// The word for people and JSON: "valid", "shadow", "saturated", "low modulation", "inconsistent code".
const char* name_of(Validity validity);

enum class EdgeRule { plain, redundant };

/// Which maps are wanted; the others stay empty. phase: phase_rad and validity. measuring: modulation and u_phase_rad
/// too, what a reconstruction asks for.
enum class Detail { phase, measuring, all };

struct DecodeOptions {
  EdgeRule edges = EdgeRule::redundant;
  // Below this many grey levels (at 8 bit; scaled with the depth) of B a pixel is not used: at 4 levels and one level
  // of noise u(phi) is 0.18 rad, where order errors begin.
  double min_modulation_8bit = 4.0;
  // Where the capture itself cannot tell the noise, or the user knows better: standard deviation in grey levels.
  std::optional<double> sigma_gray_levels;
  Detail detail = Detail::all;
};

/// sigma^2(I) = read_variance + gain I, in grey levels of the capture.
struct NoiseModel {
  double read_variance = 0, gain = 0;
  std::string source;  // "estimated from the capture's own frames", "given", ...
  double sigma(double level) const;
};

struct PhaseMap {
  CodeAxis axis = CodeAxis::x;
  FringeCode code;
  EdgeRule edges = EdgeRule::redundant;
  Image<float> phase_rad;        // absolute, eq. 3; quiet NaN where not valid (for files; use validity in arithmetic)
  Image<float> wrapped_rad;      // (-pi, pi]; empty without phase patterns
  Image<float> modulation;       // B in grey levels; without phase patterns half the difference of the references
  Image<float> mean;             // A in grey levels
  Image<float> u_phase_rad;      // eq. 4; quiet NaN where not valid
  Image<std::uint8_t> validity;  // Validity
  NoiseModel noise;

  int width() const { return validity.width(); }
  int height() const { return validity.height(); }
  bool valid(int x, int y) const { return validity(x, y) == 0; }
  /// Pattern coordinate u in the code's unit (core/pattern_plan.h).
  double u_at(int x, int y) const { return code.u_from_phase(phase_rad(x, y)); }
};

/// Number of pixels per Validity, in its order.
std::array<std::size_t, 5> count_validity(const PhaseMap& map);

/// What a person wants to know of a map first. Medians are over the valid pixels, absent where there are none.
struct DecodeSummary {
  std::array<std::size_t, 5> counts{};  // as count_validity
  std::optional<double> median_u_phase_rad;
  std::optional<double> median_u_pattern;   // the same as a length on the pattern, in the code's unit
  std::optional<double> median_modulation;  // grey levels
  double mean_level = 0;                    // mean of A over all pixels, grey levels
};
DecodeSummary summary_of(const PhaseMap& map);

/// Throws InputError where the capture has no code along that axis. Deterministic, whatever the thread count and the
/// width of the machine's vectors. reused: an earlier map whose memory is taken; fresh pages cost several times what the
/// decoding does. Four steps with a Gray code of at most 14 bits against their own mean take the pass of four_step.h;
/// everything else the general one.
PhaseMap decode_phase(const Capture& capture, CodeAxis axis, const DecodeOptions& options = {}, PhaseMap reused = {});

}  // namespace fringecal::decode
