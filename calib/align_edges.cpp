#include "calib/align_edges.h"

#include "core/parallel.h"
#include "core/statistics.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::calib {
namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;
// A plane leaves the wraps of a line within 0.003 periods of a cubic (projective terms of 4th order); 0.03 is reached
// by a bump of about half a millimetre at the default geometry.
constexpr double kMaxNonflatness = 0.03;
constexpr double kMinCovered = 0.5;
constexpr double kMaxSaturated = 0.05;

/// One line of every frame that takes part, and what follows from it pixel by pixel.
struct Line {
  std::vector<std::vector<float>> gray;  // by bit
  std::vector<double> S, C, B;           // decode.h, eqs. 1 and 2
  std::vector<double> sum_A;             // prefix sums: sum_A[x] = A(0) + .. + A(x - 1)
  std::vector<char> usable;
  int saturated = 0;
};

std::vector<float> line_of(const GrayImage& image, CodeAxis axis, int line) {
  return std::visit(
      [&](const auto& i) {
        const int length = axis == CodeAxis::x ? i.width() : i.height();
        std::vector<float> out(static_cast<std::size_t>(length));
        for (int x = 0; x < length; ++x) out[x] = static_cast<float>(axis == CodeAxis::x ? i(x, line) : i(line, x));
        return out;
      },
      image);
}

Line read_line(const Capture& capture, CodeAxis axis, int line, double min_modulation) {
  const FringeCode& code = *capture.info.plan.code(axis);
  Line out;
  for (int b = 0; b < code.gray_bits; ++b) {
    out.gray.push_back(line_of(capture.frames[*capture.info.plan.find({PatternKind::gray, axis, b})], axis, line));
  }
  const std::size_t length = out.gray.front().size();
  out.S.assign(length, 0.0);
  out.C.assign(length, 0.0);
  out.B.assign(length, 0.0);
  out.usable.assign(length, 1);
  std::vector<double> A(length, 0.0);
  const double full = capture.saturation_level();
  const int N = code.phase_steps;
  for (int k = 0; k < N; ++k) {
    const auto I = line_of(capture.frames[*capture.info.plan.find({PatternKind::phase, axis, k})], axis, line);
    const double sine = std::sin(kTwoPi * k / N), cosine = std::cos(kTwoPi * k / N);
    for (std::size_t x = 0; x < length; ++x) {
      out.S[x] += I[x] * sine;
      out.C[x] += I[x] * cosine;
      A[x] += I[x] / N;
      if (I[x] >= full) out.usable[x] = 2;  // saturated, for the moment
    }
  }
  out.sum_A.assign(length + 1, 0.0);
  for (std::size_t x = 0; x < length; ++x) {
    out.B[x] = 2.0 / N * std::hypot(out.S[x], out.C[x]);
    out.sum_A[x + 1] = out.sum_A[x] + A[x];
    if (out.usable[x] == 2) ++out.saturated;
    out.usable[x] = out.usable[x] == 1 && out.B[x] >= min_modulation;
  }
  return out;
}

/// The mean of A over [x - width/2, x + width/2] of the piecewise constant A: eq. 2. Pixel j covers [j - 1/2, j +
/// 1/2].
double mean_of_A(const Line& line, double x, double width) {
  const auto integral = [&](double to) {
    const double edge = std::clamp(to + 0.5, 0.0, static_cast<double>(line.sum_A.size() - 1));
    const auto whole = std::min(static_cast<std::size_t>(edge), line.sum_A.size() - 2);
    return line.sum_A[whole] + (edge - static_cast<double>(whole)) * (line.sum_A[whole + 1] - line.sum_A[whole]);
  };
  return (integral(x + 0.5 * width) - integral(x - 0.5 * width)) / width;
}

/// Zero of a straight line through (x, y(x)), x = centre - half .. centre + half, relative to centre.
template <class Y>
double zero_of_line(int centre, int half, const Y& y) {
  double s0 = 0, s1 = 0, s2 = 0;
  for (int d = -half; d <= half; ++d) {
    const double v = y(centre + d);
    s0 += v;
    s1 += v * d;
    s2 += static_cast<double>(d) * d;
  }
  const double n = 2.0 * half + 1.0;
  return s1 == 0 ? 1e9 : -(s0 / n) / (s1 / s2);
}

/// Eq. 1 around pixel `at` with the local angular frequency.
double refine_wrap(const Line& line, int at, double period_px) {
  const int length = static_cast<int>(line.S.size());
  const int half = std::clamp(static_cast<int>(period_px / 5.0), 1, 12);
  if (at - half < 0 || at + half >= length) return -1e9;
  Eigen::Matrix2d M = Eigen::Matrix2d::Zero();
  Eigen::Vector2d r = Eigen::Vector2d::Zero();
  const double w = kTwoPi / period_px;
  for (int d = -half; d <= half; ++d) {
    const Eigen::Vector2d f(std::sin(w * d), std::cos(w * d));
    M += f * f.transpose();
    r += f * line.S[at + d];
  }
  const Eigen::Vector2d c = M.inverse() * r;
  return at - std::atan2(c[1], c[0] == 0 ? 1e-300 : std::abs(c[0])) / w * (c[0] < 0 ? -1.0 : 1.0);
}

struct RawWrap {
  double x;
  int direction;
};

/// Crossings S = 0 with C < 0, by the neighbouring pixels only. S falls there where u grows with x (sin at pi).
std::vector<RawWrap> raw_wraps(const Line& line) {
  std::vector<RawWrap> out;
  for (std::size_t x = 0; x + 1 < line.S.size(); ++x) {
    if (!line.usable[x] || !line.usable[x + 1] || line.C[x] >= 0 || line.C[x + 1] >= 0) continue;
    const double a = line.S[x], b = line.S[x + 1];
    if ((a > 0) == (b > 0)) continue;
    out.push_back({static_cast<double>(x) + a / (a - b), a > b ? 1 : -1});
  }
  return out;
}

/// Splits where pixels in between are unusable, the direction turns, or a spacing leaves 0.6 .. 1.5 of its neighbour.
std::vector<std::vector<RawWrap>> split(const Line& line, const std::vector<RawWrap>& wraps) {
  std::vector<std::vector<RawWrap>> out;
  for (const RawWrap& w : wraps) {
    bool joins = !out.empty();
    if (joins) {
      const auto& run = out.back();
      const double spacing = w.x - run.back().x;
      joins = w.direction == run.back().direction;
      for (int x = static_cast<int>(run.back().x); joins && x <= static_cast<int>(w.x); ++x) joins = line.usable[x];
      if (joins && run.size() >= 2) {
        const double before = run.back().x - run[run.size() - 2].x;
        joins = spacing > 0.6 * before && spacing < 1.5 * before;
      }
    }
    if (joins)
      out.back().push_back(w);
    else
      out.push_back({w});
  }
  return out;
}

/// rms of the wraps about a cubic in x.
double nonflatness(const std::vector<double>& wraps) {
  const int n = static_cast<int>(wraps.size());
  Eigen::MatrixXd M(n, 4);
  Eigen::VectorXd q(n);
  const double middle = 0.5 * (wraps.front() + wraps.back()), half = 0.5 * (wraps.back() - wraps.front());
  for (int i = 0; i < n; ++i) {
    const double t = (wraps[i] - middle) / half;
    M.row(i) << 1, t, t * t, t * t * t;
    q[i] = i;
  }
  const Eigen::Vector4d c = (M.transpose() * M).ldlt().solve(M.transpose() * q);
  return (M * c - q).norm() / std::sqrt(std::max(1, n - 4));
}

struct Place {
  double q, period_px;
};

/// Eq. 3 through the six wraps nearest to x and the five zeros between them; q counts along x here.
Place place_of(const EdgeSegment& segment, double x) {
  const auto& wraps = segment.wraps_px;
  const int n = static_cast<int>(wraps.size());
  const int after = static_cast<int>(std::lower_bound(wraps.begin(), wraps.end(), x) - wraps.begin());
  const int first = std::clamp(after - 3, 0, n - 6);
  const double scale = (wraps[first + 5] - wraps[first]) / 5.0;
  Eigen::Matrix4d M = Eigen::Matrix4d::Zero();
  Eigen::Vector4d r = Eigen::Vector4d::Zero();
  const auto add = [&](double place_px, double count, double sign) {
    const double t = (place_px - x) / scale;
    const Eigen::Vector4d f(1, t, t * t, sign);
    M += f * f.transpose();
    r += f * count;
  };
  for (int i = first; i < first + 6; ++i) {
    add(wraps[i], i, 1.0);
    if (i < first + 5) add(segment.middles_px[i], i + 0.5, -1.0);
  }
  const Eigen::Vector4d c = M.ldlt().solve(r);
  return {c[0], scale / c[1]};
}

/// Eq. 2 for every bit within the segment's wraps.
void add_edges(const Line& line, EdgeSegment& segment) {
  const int n = static_cast<int>(segment.wraps_px.size());
  const int first = static_cast<int>(std::ceil(segment.wraps_px.front()));
  const int last = static_cast<int>(segment.wraps_px.back());
  std::vector<double> threshold(static_cast<std::size_t>(last + 1));
  for (int x = first, i = 0; x <= last; ++x) {
    while (i + 2 < n && segment.wraps_px[i + 1] < x) ++i;
    threshold[x] = mean_of_A(line, x, segment.wraps_px[i + 1] - segment.wraps_px[i]);
  }
  for (int b = 0; b < static_cast<int>(line.gray.size()); ++b) {
    const auto& G = line.gray[b];
    const auto D = [&](int x) { return G[x] - threshold[x]; };
    double previous_x = -1e9;
    for (int x = first; x < last; ++x) {
      if ((D(x) > 0) == (D(x + 1) > 0)) continue;
      const Place here = place_of(segment, x + 0.5);
      const int quarter = std::max(2, static_cast<int>(0.25 * here.period_px));
      const int half = std::clamp(static_cast<int>(0.1 * here.period_px), 1, 8);
      if (x - quarter + 1 < first || x + quarter > last || x + 0.5 - previous_x < here.period_px / 2) continue;
      // Eq. 2 needs the whole period around the edge inside the picture.
      if (x < 0.5 * here.period_px || x + 1 + 0.5 * here.period_px > static_cast<double>(G.size() - 1)) continue;
      double before = 0, after = 0;
      for (int d = 0; d < quarter; ++d) {
        before += D(x - d) / quarter;
        after += D(x + 1 + d) / quarter;
      }
      // Noise in a dark place also crosses the threshold: a real edge changes by about 1.5 B within half a period.
      if ((before > 0) == (after > 0) || std::abs(after - before) < 0.5 * line.B[x]) continue;
      // The nearer pixel is the middle of the fit, so that what is odd about the edge cancels.
      const int centre = std::abs(D(x)) <= std::abs(D(x + 1)) ? x : x + 1;
      if (centre - half < first || centre + half > last) continue;
      const double offset = zero_of_line(centre, half, D);
      if (!(std::abs(offset) <= half + 0.5)) continue;
      const Place place = place_of(segment, centre + offset);
      segment.edges.push_back({.bit = b,
                               .rising = (after > before) == (segment.direction > 0),
                               .x_px = centre + offset,
                               .q_periods = segment.direction * place.q,
                               .period_px = place.period_px});
      previous_x = centre + offset;
    }
  }
}

/// The zeros of S with C > 0 between the wraps; false where no sine fits.
bool add_middles(const Line& line, EdgeSegment& segment) {
  for (std::size_t i = 0; i + 1 < segment.wraps_px.size(); ++i) {
    const double period = segment.wraps_px[i + 1] - segment.wraps_px[i];
    const double middle = 0.5 * (segment.wraps_px[i] + segment.wraps_px[i + 1]);
    segment.middles_px.push_back(refine_wrap(line, static_cast<int>(std::lround(middle)), period));
    if (!(std::abs(segment.middles_px.back() - middle) < 0.25 * period)) return false;
  }
  return true;
}

std::vector<EdgeSegment> segments_of(const Line& line, int number, const EdgeOptions& options) {
  std::vector<EdgeSegment> out;
  for (const auto& run : split(line, raw_wraps(line))) {
    if (static_cast<int>(run.size()) < options.min_wraps) continue;
    EdgeSegment segment{
        .line = number, .direction = run.front().direction, .wraps_px = {}, .middles_px = {}, .edges = {}};
    for (std::size_t i = 0; i < run.size(); ++i) {
      const std::size_t a = i == 0 ? 0 : i - 1, b = std::min(i + 1, run.size() - 1);
      const double period = (run[b].x - run[a].x) / static_cast<double>(b - a);
      const double x = refine_wrap(line, static_cast<int>(std::lround(run[i].x)), period);
      if (std::abs(x - run[i].x) < 0.25 * period)
        segment.wraps_px.push_back(x);
      else if (i > 0 && i + 1 < run.size()) {
        segment.wraps_px.clear();
        break;
      }  // an inner wrap that no sine fits
    }
    if (!add_middles(line, segment) || static_cast<int>(segment.wraps_px.size()) < options.min_wraps) continue;
    segment.nonflatness_periods = nonflatness(segment.wraps_px);
    add_edges(line, segment);
    out.push_back(std::move(segment));
  }
  return out;
}

}  // namespace

EdgeMap find_edges(const Capture& capture, CodeAxis axis, const EdgeOptions& options) {
  const auto& code = capture.info.plan.code(axis);
  require(code && code->gray_bits > 0 && code->phase_steps >= 3,
          "edges need Gray bits and phase patterns along the axis");
  const int lines = axis == CodeAxis::x ? capture.info.height_px : capture.info.width_px;
  const double min_modulation = options.min_modulation_8bit * std::ldexp(1.0, capture.info.bits - 8);
  struct PerLine {
    std::vector<EdgeSegment> segments;
    double median_B = 0;
    std::size_t usable = 0, saturated = 0, length = 0;
  };
  std::vector<PerLine> per_line(static_cast<std::size_t>(lines));
  parallel_for(lines, [&](int i) {
    Line line = read_line(capture, axis, i, min_modulation);
    PerLine& out = per_line[i];
    out.segments = segments_of(line, i, options);
    out.length = line.B.size();
    out.usable = static_cast<std::size_t>(std::count(line.usable.begin(), line.usable.end(), 1));
    out.saturated = static_cast<std::size_t>(line.saturated);
    const auto middle = line.B.begin() + static_cast<std::ptrdiff_t>(line.B.size() / 2);
    std::nth_element(line.B.begin(), middle, line.B.end());
    out.median_B = *middle;
  });
  EdgeMap map;
  map.lines = lines;
  std::vector<double> medians;
  double usable = 0, saturated = 0, pixels = 0;
  for (PerLine& line : per_line) {
    medians.push_back(line.median_B);
    usable += static_cast<double>(line.usable);
    saturated += static_cast<double>(line.saturated);
    pixels += static_cast<double>(line.length);
    std::move(line.segments.begin(), line.segments.end(), std::back_inserter(map.segments));
  }
  std::nth_element(medians.begin(), medians.begin() + lines / 2, medians.end());
  map.median_modulation = medians[static_cast<std::size_t>(lines) / 2];
  map.covered = usable / pixels;
  map.saturated = saturated / pixels;
  return map;
}

std::optional<std::string> defect_of(const EdgeMap& map, const Capture& capture) {
  const double limit = EdgeOptions{}.min_modulation_8bit * std::ldexp(1.0, capture.info.bits - 8);
  if (map.saturated > kMaxSaturated) {
    return fmt::format("{:.0f} % of the pixels are saturated in a phase frame (at most {:.0f} %): expose less",
                       100 * map.saturated, 100 * kMaxSaturated);
  }
  if (map.covered < kMinCovered) {
    if (map.median_modulation < limit && map.covered < 0.1) {
      return fmt::format(
          "the modulation is {:.1f} grey levels (median; {:.0f} are needed): more light, a white board, or an "
          "angle of the grating so far off that the phase steps cancel",
          map.median_modulation, limit);
    }
    return fmt::format(
        "only {:.0f} % of the picture shows fringes of at least {:.0f} grey levels ({:.0f} % are needed): the "
        "board is partly out of the field, too small or too dark",
        100 * map.covered, limit, 100 * kMinCovered);
  }
  if (map.segments.empty()) return std::string("no row shows six periods of the fringes in a run");
  std::vector<double> nonflat;
  for (const auto& s : map.segments) nonflat.push_back(s.nonflatness_periods);
  const double typical = median(nonflat);
  const auto curved = std::count_if(nonflat.begin(), nonflat.end(), [](double n) { return n > kMaxNonflatness; });
  if (typical > kMaxNonflatness || static_cast<double>(curved) > 0.25 * static_cast<double>(nonflat.size())) {
    return fmt::format(
        "the board is not flat: the fringes depart by {:.3f} periods rms from those of a plane in the middle one "
        "of {} rows, and {} rows are beyond the limit of {:.3f}; put a flat board into the field",
        typical, nonflat.size(), curved, kMaxNonflatness);
  }
  return std::nullopt;
}

}  // namespace fringecal::calib
