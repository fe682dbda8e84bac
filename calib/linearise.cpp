#include "calib/linearise.h"

#include "calib/align_edges.h"
#include "calib/decode/ripple.h"
#include "core/parallel.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <cmath>

namespace fringecal::calib {
namespace {

constexpr double kClip = 5.0;   // standard deviations of the pixel's own noise ...
constexpr double kSlack = 0.1;  // ... plus this, rad: no ripple that is to be measured may be cut
constexpr int kCommon = 4;      // cos, sin of one and two cycles, the same over the field

struct Solution {
  Eigen::VectorXd amplitude, u;
};

/// The normal equations of eq. 1 over one map.
class NodeFit {
 public:
  NodeFit(const decode::PhaseMap& map, const LineariseOptions& grid) : map_(map), grid_(grid) {}

  int unknowns() const { return kCommon + 2 * grid_.columns * grid_.rows; }

  Solution solve() const {
    constexpr int kBand = 32;
    const int lines = map_.axis == CodeAxis::x ? map_.height() : map_.width(), bands = (lines + kBand - 1) / kBand;
    std::vector<Sums> parts(static_cast<std::size_t>(bands));
    parallel_for(bands, [&](int band) {
      Sums& sums = parts[static_cast<std::size_t>(band)];
      sums = Sums(unknowns());
      for (int i = band * kBand; i < std::min(lines, (band + 1) * kBand); ++i) add_line(i, sums);
    });
    Sums total(unknowns());
    for (const Sums& part : parts) {
      total.normal += part.normal;
      total.right += part.right;
      total.squares += part.squares;
      total.n += part.n;
    }
    // A node without pixels stays at zero with the uncertainty of one radian.
    total.normal.diagonal().array() += 1e-9;
    const Eigen::MatrixXd full = total.normal.selfadjointView<Eigen::Lower>();
    const Eigen::LLT<Eigen::MatrixXd> factor(full);
    Solution out{.amplitude = factor.solve(total.right), .u = {}};
    const double rest = std::max(0.0, total.squares - out.amplitude.dot(total.right)) / std::max(1.0, total.n);
    const Eigen::MatrixXd inverse = factor.solve(Eigen::MatrixXd::Identity(unknowns(), unknowns()));
    out.u = (inverse.diagonal() * rest).cwiseSqrt();
    return out;
  }

 private:
  struct Sums {
    Sums() = default;
    explicit Sums(int n_unknowns)
        : normal(Eigen::MatrixXd::Zero(n_unknowns, n_unknowns)), right(Eigen::VectorXd::Zero(n_unknowns)) {}
    Eigen::MatrixXd normal;
    Eigen::VectorXd right;
    double squares = 0, n = 0;
  };

  void add_line(int number, Sums& sums) const {
    const bool rows = map_.axis == CodeAxis::x;
    const int length = rows ? map_.width() : map_.height();
    decode::RippleLine line{std::vector<double>(length), std::vector<double>(length), std::vector<char>(length)};
    for (int i = 0; i < length; ++i) {
      const int x = rows ? i : number, y = rows ? number : i;
      line.usable[i] = map_.valid(x, y);
      if (!line.usable[i]) continue;
      line.phase_rad[i] = line.y[i] = map_.phase_rad(x, y);
    }
    decode::for_each_high_passed(line, map_.code.phase_steps, [&](int i, double y_hp, const decode::RippleTerms& f) {
      const int x = rows ? i : number, y = rows ? number : i;
      if (!(std::abs(y_hp) <= kSlack + kClip * map_.u_phase_rad(x, y))) return;
      const double at_x = static_cast<double>(x) * (grid_.columns - 1) / (map_.width() - 1);
      const double at_y = static_cast<double>(y) * (grid_.rows - 1) / (map_.height() - 1);
      const int column = std::min(static_cast<int>(at_x), grid_.columns - 2);
      const int row = std::min(static_cast<int>(at_y), grid_.rows - 2);
      const double s = at_x - column, t = at_y - row;
      int place[kCommon + 8];
      double value[kCommon + 8];
      for (int k = 0; k < kCommon; ++k) {
        place[k] = k;
        value[k] = f[static_cast<std::size_t>(k)];
      }
      int k = kCommon;
      for (int j = 0; j < 4; ++j) {
        const double hat = (j % 2 == 1 ? s : 1 - s) * (j / 2 == 1 ? t : 1 - t);
        const int node = (row + j / 2) * grid_.columns + column + j % 2;
        for (int part = 0; part < 2; ++part, ++k) {
          place[k] = kCommon + 2 * node + part;
          value[k] = hat * f[static_cast<std::size_t>(kCommon + part)];
        }
      }
      // `place` rises, so the lower triangle is (later, earlier).
      for (int a = 0; a < kCommon + 8; ++a) {
        for (int b = 0; b <= a; ++b) sums.normal(place[a], place[b]) += value[a] * value[b];
        sums.right[place[a]] += value[a] * y_hp;
      }
      sums.squares += y_hp * y_hp;
      sums.n += 1;
    });
  }

  const decode::PhaseMap& map_;
  LineariseOptions grid_;
};

}  // namespace

struct LinearisationFit::State {
  CodeAxis axis;
  LineariseOptions grid;
  model::PhaseLinearisation table;  // without the averages
  std::vector<Solution> solutions;
  std::vector<model::StepEllipse> ellipses;
};

LinearisationFit::LinearisationFit(CodeAxis axis, const LineariseOptions& options)
    : state_(std::make_unique<State>(State{axis, options, {}, {}, {}})) {
  require(options.columns >= 2 && options.rows >= 2, "a linearisation's grid has at least two nodes each way");
}
LinearisationFit::~LinearisationFit() = default;
LinearisationFit::LinearisationFit(LinearisationFit&&) noexcept = default;

Result<void> LinearisationFit::add(const Capture& capture, const std::string& name, const std::string& hash) {
  State& s = *state_;
  const auto& code = capture.info.plan.code(s.axis);
  if (!code || code->phase_steps < 3 || code->gray_bits < 2) {
    throw InputError(fmt::format("{}: the linearisation needs phase patterns and Gray bits along {}", name,
                                 s.axis == CodeAxis::x ? "x" : "y"));
  }
  auto& table = s.table;
  if (!s.solutions.empty() && (code->phase_steps != table.phase_steps || code->period != table.period ||
                               capture.info.width_px != table.width_px || capture.info.height_px != table.height_px)) {
    throw InputError(fmt::format("{}: another image size or grating than in {}", name, table.inputs.front().first));
  }
  if (const auto defect = defect_of(find_edges(capture, s.axis), capture)) {
    return unanswerable(fmt::format("{}: {}", name, *defect));
  }
  decode::PhaseMap map = decode::decode_phase(capture, s.axis);
  const auto errors = decode::estimate_stack_errors(capture, map);
  if (!errors) return unanswerable(fmt::format("{}: {}", name, errors.error().sentence));
  decode::undo_ellipse(map, errors->ellipse);
  s.solutions.push_back(NodeFit(map, s.grid).solve());
  s.ellipses.push_back(errors->ellipse);
  table.axis = s.axis;
  table.phase_steps = code->phase_steps;
  table.period = code->period;
  table.width_px = capture.info.width_px;
  table.height_px = capture.info.height_px;
  table.columns = s.grid.columns;
  table.rows = s.grid.rows;
  table.inputs.emplace_back(name, hash);
  return {};
}

model::PhaseLinearisation LinearisationFit::table() const {
  const State& s = *state_;
  require(!s.solutions.empty(), "a linearisation has at least one stack");
  model::PhaseLinearisation out = s.table;
  const double n = static_cast<double>(s.solutions.size());
  out.stacks = static_cast<int>(s.solutions.size());
  for (int node = 0; node < s.grid.columns * s.grid.rows; ++node) {
    const Eigen::Index k = kCommon + 2 * node;
    double mean[2] = {}, scatter = 0, noise = 0;
    for (const Solution& one : s.solutions) {
      for (int part = 0; part < 2; ++part) {
        mean[part] += one.amplitude[k + part] / n;
        noise += 0.5 * one.u[k + part] * one.u[k + part] / (n * n);
      }
    }
    for (const Solution& one : s.solutions) {
      for (int part = 0; part < 2; ++part) scatter += std::pow(one.amplitude[k + part] - mean[part], 2);
    }
    if (n > 1) scatter /= 2 * (n - 1) * n;
    out.ripple_rad.emplace_back(mean[0], mean[1]);
    out.u_ripple_rad.push_back(std::sqrt(std::max(noise, scatter)));
  }
  for (const auto& e : s.ellipses) {
    out.fixed.offset += e.offset / n;
    out.fixed.conjugate += e.conjugate / n;
    out.fixed.third += e.third / n;
    out.fixed.u_offset = std::hypot(out.fixed.u_offset, e.u_offset / n);
    out.fixed.u_conjugate = std::hypot(out.fixed.u_conjugate, e.u_conjugate / n);
  }
  if (n > 1) {
    double offset = 0, conjugate = 0;
    for (const auto& e : s.ellipses) {
      offset += std::norm(e.offset - out.fixed.offset);
      conjugate += std::norm(e.conjugate - out.fixed.conjugate);
    }
    out.sd_offset = std::sqrt(offset / (2 * (n - 1)));
    out.sd_conjugate = std::sqrt(conjugate / (2 * (n - 1)));
    out.fixed.u_offset = out.sd_offset / std::sqrt(n);
    out.fixed.u_conjugate = out.sd_conjugate / std::sqrt(n);
  }
  return out;
}

double LinearisationFit::left_over_rad() const {
  const State& s = *state_;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(kCommon);
  for (const Solution& one : s.solutions) mean += one.amplitude.head(kCommon) / static_cast<double>(s.solutions.size());
  return std::max(mean.head<2>().norm(), mean.tail<2>().norm());
}

}  // namespace fringecal::calib
