#include "metrology/uncertainty_map.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::metrology {
namespace {

constexpr double kOpenRelative = 1e-4;  // of the working distance
constexpr double kLeastShare = 0.4;

enum class Block { camera, projector, pose };
Block block_of(const std::string& name) {
  if (name.starts_with("camera.")) return Block::camera;
  return name.starts_with("projector.") ? Block::projector : Block::pose;
}

/// C with only one block left.
Eigen::MatrixXd only(const model::ParameterCovariance& u, Block block) {
  Eigen::MatrixXd c = u.covariance;
  for (Eigen::Index i = 0; i < c.rows(); ++i) {
    if (block_of(u.names[static_cast<std::size_t>(i)]) == block) continue;
    c.row(i).setZero();
    c.col(i).setZero();
  }
  return c;
}

struct Parts {
  Eigen::MatrixXd whole, camera, projector, pose;
};

/// dP/du at a sample, by central differences of a thousandth of a period.
Eigen::Vector3d by_coordinate(const model::Scanner& s, const VolumeSample& sample) {
  const double step = 1e-3 * s.projector.axis(s.projector.main_axis())->code.period;
  VolumeSample up = sample, down = sample;
  up.u += step;
  down.u -= step;
  const auto a = seen_by(s, std::span(&up, 1)), b = seen_by(s, std::span(&down, 1));
  return a && b ? Eigen::Vector3d((a->col(0) - b->col(0)) / (2.0 * step)) : Eigen::Vector3d(Eigen::Vector3d::Zero());
}

PointUncertainty at_point(const model::Scanner& s, const VolumeSample& sample, const Eigen::MatrixXd& j,
                          const Parts& parts, double u_coordinate) {
  const auto trace = [&](const Eigen::MatrixXd& c) { return (j * c * j.transpose()).diagonal().cwiseMax(0.0).eval(); };
  const Eigen::Vector3d calibration = trace(parts.whole);
  const Eigen::Vector3d phase = (by_coordinate(s, sample) * u_coordinate).cwiseAbs2();
  PointUncertainty p;
  p.point_mm = sample.point_mm;
  p.u_mm = (calibration + phase).cwiseSqrt();  // eq. 1
  p.camera_mm = std::sqrt(trace(parts.camera).sum());
  p.projector_mm = std::sqrt(trace(parts.projector).sum());
  p.pose_mm = std::sqrt(trace(parts.pose).sum());
  p.calibration_mm = std::sqrt(calibration.sum());
  p.phase_mm = std::sqrt(phase.sum());
  p.total_mm = p.u_mm.norm();
  return p;
}

/// Eq. 2. `by`: J of the grid's points.
std::vector<OpenCombination> combinations_of(const model::Scanner& s, const std::vector<VolumeSample>& volume,
                                             const Eigen::MatrixXd& by) {
  const Eigen::MatrixXd& c = s.uncertainty.covariance;
  const Eigen::VectorXd u = c.diagonal().cwiseMax(1e-300).cwiseSqrt();
  // C = D K D with K the correlations: parameters of all units on one scale.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> k(u.cwiseInverse().asDiagonal() * c *
                                                         u.cwiseInverse().asDiagonal());
  const Eigen::MatrixXd l = u.asDiagonal() * k.eigenvectors() * k.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
  const Eigen::MatrixXd moved = by * l;
  const double n = static_cast<double>(volume.size());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(moved.transpose() * moved / n);
  const double whole = modes.eigenvalues().cwiseMax(0.0).sum();
  std::vector<OpenCombination> out;
  double sum = 0;
  for (Eigen::Index m = c.rows() - 1; m >= 0 && out.size() < 6 && sum < 0.99 * whole; --m) {
    const double variance = std::max(modes.eigenvalues()[m], 0.0);
    sum += variance;
    OpenCombination one;
    one.rms_mm = std::sqrt(variance);
    const Eigen::VectorXd d = moved * modes.eigenvectors().col(m), change = l * modes.eigenvectors().col(m);
    for (std::size_t i = 0; i < volume.size(); ++i) {
      const double size = d.segment<3>(static_cast<Eigen::Index>(3 * i)).norm();
      if (size > one.worst_mm) {
        one.worst_mm = size;
        one.worst_at_mm = volume[i].point_mm;
      }
    }
    for (Eigen::Index i = 0; i < c.rows(); ++i) {
      const double share = change[i] / u[i];
      if (std::abs(share) >= kLeastShare)
        one.shares.push_back({s.uncertainty.names[static_cast<std::size_t>(i)], share});
    }
    std::stable_sort(one.shares.begin(), one.shares.end(),
                     [](const auto& a, const auto& b) { return std::abs(a.in_u) > std::abs(b.in_u); });
    // The sign of a direction has no meaning: the largest share counts as positive.
    const double sign = !one.shares.empty() && one.shares.front().in_u < 0 ? -1.0 : 1.0;
    for (auto& share : one.shares) share.in_u *= sign;
    one.open = one.worst_mm > kOpenRelative * s.working_distance_mm;
    out.push_back(std::move(one));
  }
  return out;
}

std::vector<HeldByPrior> held_by_priors(const model::Scanner& s, const Eigen::MatrixXd& by) {
  std::vector<HeldByPrior> out;
  for (const auto& prior : s.priors) {
    const auto u = s.uncertainty.u(prior.parameter);
    if (!u || !(*u > 0.5 * prior.u)) continue;
    const auto column = std::find(s.uncertainty.names.begin(), s.uncertainty.names.end(), prior.parameter) -
                        s.uncertainty.names.begin();
    HeldByPrior held{prior.parameter, *u, prior.u, 0};
    for (Eigen::Index i = 0; i + 2 < by.rows(); i += 3) {
      held.worst_mm = std::max(held.worst_mm, *u * by.block<3, 1>(i, column).norm());
    }
    out.push_back(held);
  }
  return out;
}

/// The grid of a section through the middle of the points, and the samples on it.
Section section_of(const std::vector<VolumeSample>& volume, int axis, int steps) {
  Eigen::Vector3d low = volume.front().point_mm, high = low;
  for (const auto& v : volume) {
    low = low.cwiseMin(v.point_mm);
    high = high.cwiseMax(v.point_mm);
  }
  const int a = axis == 0 ? 1 : 0, b = axis == 2 ? 1 : 2;
  Section out;
  out.across = "xyz"[axis];
  out.at_mm = 0.5 * (low[axis] + high[axis]);
  out.first_x_mm = low[a];
  out.first_y_mm = low[b];
  out.step_mm = std::max(high[a] - low[a], high[b] - low[b]) / std::max(steps - 1, 1);
  out.columns = static_cast<int>(std::floor((high[a] - low[a]) / out.step_mm + 1.5));
  out.rows = static_cast<int>(std::floor((high[b] - low[b]) / out.step_mm + 1.5));
  return out;
}

Eigen::Vector3d place_on(const Section& s, int column, int row) {
  const double x = s.first_x_mm + column * s.step_mm, y = s.first_y_mm + row * s.step_mm;
  if (s.across == 'x') return {s.at_mm, x, y};
  return s.across == 'y' ? Eigen::Vector3d(x, s.at_mm, y) : Eigen::Vector3d(x, y, s.at_mm);
}

}  // namespace

Result<UncertaintyMap> uncertainty_map(const model::Scanner& s, const MapOptions& options) {
  const auto volume = samples_of(s, options.grid);
  if (volume.size() < 20) {
    return unanswerable(
        fmt::format("camera and fringes share only {} points of the volume; give --z-min and --z-max", volume.size()));
  }
  UncertaintyMap out;
  std::vector<VolumeSample> more;
  for (int axis = 2; axis >= 0 && options.section_steps > 0; --axis) {
    Section section = section_of(volume, axis, options.section_steps);
    for (int row = 0; row < section.rows; ++row) {
      for (int column = 0; column < section.columns; ++column) {
        const auto sample = sample_at(s, place_on(section, column, row));
        section.values.push_back(sample ? std::optional(PointUncertainty{}) : std::nullopt);
        if (sample) more.push_back(*sample);
      }
    }
    out.sections.push_back(std::move(section));
  }
  const auto by = derivatives(s, volume, more);
  if (!by) return tl::unexpected(by.error());
  const Parts parts{s.uncertainty.covariance, only(s.uncertainty, Block::camera), only(s.uncertainty, Block::projector),
                    only(s.uncertainty, Block::pose)};
  const double period = s.projector.axis(s.projector.main_axis())->code.period;
  const double u_coordinate = period * options.u_phase_rad / (2.0 * std::numbers::pi);  // eq. 1
  double squares = 0;
  const auto evaluate = [&](const VolumeSample& sample, std::size_t row) {
    return at_point(s, sample, by->middleRows(static_cast<Eigen::Index>(3 * row), 3), parts, u_coordinate);
  };
  for (std::size_t i = 0; i < volume.size(); ++i) {
    out.points.push_back(evaluate(volume[i], i));
    const auto& p = out.points.back();
    squares += p.calibration_mm * p.calibration_mm;
    if (p.calibration_mm > out.worst_mm) {
      out.worst_mm = p.calibration_mm;
      out.worst_at_mm = p.point_mm;
    }
  }
  out.rms_mm = std::sqrt(squares / static_cast<double>(volume.size()));
  std::size_t next = 0;
  for (auto& section : out.sections) {
    for (auto& value : section.values) {
      if (!value) continue;
      value = evaluate(more[next], volume.size() + next);
      ++next;
    }
  }
  const Eigen::MatrixXd on_grid = by->topRows(static_cast<Eigen::Index>(3 * volume.size()));
  out.combinations = combinations_of(s, volume, on_grid);
  out.held = held_by_priors(s, on_grid);
  if (!std::isfinite(out.rms_mm))
    return unanswerable("the covariance does not give finite uncertainties; calibrate again");
  return out;
}

std::vector<std::string> open_words(const UncertaintyMap& map) {
  std::vector<std::string> out;
  for (const auto& c : map.combinations) {
    if (!c.open) continue;
    std::string words;
    for (const auto& share : c.shares) {
      words += fmt::format("{}{} {:+.2f} u", words.empty() ? "" : ", ", share.parameter, share.in_u);
    }
    out.push_back(fmt::format("left open: {}: {:.3f} mm at ({:.0f}, {:.0f}, {:.0f}) mm, {:.3f} mm rms over the volume",
                              words.empty() ? "many parameters together" : words, c.worst_mm, c.worst_at_mm.x(),
                              c.worst_at_mm.y(), c.worst_at_mm.z(), c.rms_mm));
  }
  for (const auto& h : map.held) {
    out.push_back(fmt::format(
        "held by its prior, not by the views: {} (u = {:.3g}, prior {:.3g}); it moves the volume's edge by {:.4f} mm",
        h.parameter, h.u, h.u_prior, h.worst_mm));
  }
  return out;
}

Value to_value(const UncertaintyMap& map) {
  Value points = Value::array(), combinations = Value::array(), words = Value::array();
  for (const auto& p : map.points) {
    points.append(Value::object()
                      .set("point_mm", Value::numbers(p.point_mm))
                      .set("u_mm", Value::numbers(p.u_mm))
                      .set("camera_mm", p.camera_mm)
                      .set("projector_mm", p.projector_mm)
                      .set("pose_mm", p.pose_mm)
                      .set("calibration_mm", p.calibration_mm)
                      .set("phase_mm", p.phase_mm)
                      .set("total_mm", p.total_mm));
  }
  for (const auto& c : map.combinations) {
    Value shares = Value::object();
    for (const auto& share : c.shares) shares.set(share.parameter, share.in_u);
    combinations.append(Value::object()
                            .set("rms_mm", c.rms_mm)
                            .set("worst_mm", c.worst_mm)
                            .set("worst_at_mm", Value::numbers(c.worst_at_mm))
                            .set("shares_u", shares)
                            .set("open", c.open));
  }
  for (const auto& sentence : open_words(map)) words.append(sentence);
  return Value::object()
      .set("rms_mm", map.rms_mm)
      .set("worst_mm", map.worst_mm)
      .set("worst_at_mm", Value::numbers(map.worst_at_mm))
      .set("open", words)
      .set("combinations", combinations)
      .set("points", points);
}

}  // namespace fringecal::metrology
