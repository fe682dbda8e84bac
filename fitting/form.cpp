#include "fitting/form.h"

#include "core/error.h"
#include "fitting/chebyshev.h"
#include "fitting/least_squares.h"
#include "fitting/surface.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace fringecal::fitting {
namespace {

enum class Zone { plane, circle, sphere, cylinder };

/// A surface while its zone is made smaller: the centre (or a point of the axis, of the plane), and axes whose third is
/// the axis (the plane's normal). Lengths in units of the points' size.
struct Place {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
};

class ZoneProblem {
 public:
  ZoneProblem(Zone zone, std::vector<Eigen::Vector3d> points) : zone_(zone), points_(std::move(points)) {}

  int columns() const { return zone_ == Zone::cylinder ? 5 : zone_ == Zone::sphere ? 4 : 3; }
  int shifts() const { return zone_ == Zone::plane ? 0 : zone_ == Zone::sphere ? 3 : 2; }
  int tilts() const { return zone_ == Zone::cylinder ? 2 : 0; }
  std::size_t size() const { return points_.size(); }

  Eigen::Vector3d local(const Place& at, std::size_t i) const { return at.axes.transpose() * (points_[i] - at.center); }
  double distance(const Place& at, std::size_t i) const {
    const Eigen::Vector3d u = local(at, i);
    return zone_ == Zone::plane ? u.z() : zone_ == Zone::sphere ? u.norm() : std::hypot(u.x(), u.y());
  }
  /// Row of J: the displacement (e_x, e_y[, e_z]), the tilts of the axis towards x and y, the radius.
  Eigen::VectorXd row(const Place& at, std::size_t i) const {
    const Eigen::Vector3d u = local(at, i);
    Eigen::VectorXd out(columns());
    if (zone_ == Zone::plane) {
      out << -1.0, -u.x(), -u.y();
    } else if (zone_ == Zone::sphere) {
      out << -u.normalized(), -1.0;
    } else {
      const double rho = std::max(std::hypot(u.x(), u.y()), 1e-150), x = u.x() / rho, y = u.y() / rho;
      if (zone_ == Zone::circle) {
        out << -x, -y, -1.0;
      } else {
        out << -x, -y, -x * u.z(), -y * u.z(), -1.0;
      }
    }
    return out;
  }
  Place moved(const Place& at, const Eigen::VectorXd& x) const {
    Place out = at;
    if (zone_ == Zone::plane) {
      // d = z - x_1 x - x_2 y: the normal turns towards (-x_1, -x_2, 1)
      out.axes = axes_with(at.axes.col(2) - x[1] * at.axes.col(0) - x[2] * at.axes.col(1), 2);
    } else if (zone_ == Zone::sphere) {
      out.center += at.axes * x.head<3>();
    } else {
      out.center += at.axes.leftCols<2>() * x.head<2>();
      if (zone_ == Zone::cylinder) {
        out.axes = axes_with(at.axes.col(2) + x[2] * at.axes.col(0) + x[3] * at.axes.col(1), 2);
      }
    }
    return out;
  }
  /// Eq. 3 with the displacement and tilt that are open.
  double remainder(const Place& at, double e, double w) const {
    if (zone_ == Zone::plane) return 0.0;
    double rho = std::numeric_limits<double>::infinity(), h = 0.0, far = 0.0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      rho = std::min(rho, distance(at, i));
      far = std::max(far, distance(at, i));
      if (zone_ == Zone::cylinder) h = std::max(h, std::abs(local(at, i).z()));
    }
    const double shift = e + w * h;
    if (!(shift < 0.5 * rho)) return std::numeric_limits<double>::infinity();
    return shift * shift / (2.0 * (rho - shift)) + 2.0 * w * w * (far + h);
  }

 private:
  Zone zone_;
  std::vector<Eigen::Vector3d> points_;
};

/// Eq. 2 over all points: solved over few, the worst of the others added until none is worse.
struct Active {
  Eigen::MatrixXd J;
  Eigen::VectorXd d;
  ChebyshevSolution solution;
};
Active solve_all(const Eigen::MatrixXd& J, const Eigen::VectorXd& d) {
  constexpr int kRounds = 200;
  std::vector<Eigen::Index> used;
  const auto add = [&](Eigen::Index i) {
    if (std::find(used.begin(), used.end(), i) != used.end()) return false;
    used.push_back(i);
    return true;
  };
  // extremes along each column give a first bounded problem
  for (Eigen::Index c = 0; c < J.cols(); ++c) {
    Eigen::Index low = 0, high = 0;
    J.col(c).minCoeff(&low);
    J.col(c).maxCoeff(&high);
    add(low);
    add(high);
  }
  Eigen::Index worst = 0;
  d.maxCoeff(&worst);
  add(worst);
  d.minCoeff(&worst);
  add(worst);
  Active out;
  for (int round = 0; round < kRounds; ++round) {
    out.J.resize(static_cast<Eigen::Index>(used.size()), J.cols());
    out.d.resize(static_cast<Eigen::Index>(used.size()));
    for (std::size_t i = 0; i < used.size(); ++i) {
      out.J.row(static_cast<Eigen::Index>(i)) = J.row(used[i]);
      out.d[static_cast<Eigen::Index>(i)] = d[used[i]];
    }
    out.solution = chebyshev(out.J, out.d);
    const Eigen::VectorXd left = d + J * out.solution.x;
    const double limit = out.solution.t + 1e-15 * d.cwiseAbs().maxCoeff();
    bool more = false;
    Eigen::Index high = 0, low = 0;
    if (left.maxCoeff(&high) > limit) more = add(high) || more;
    if (-left.minCoeff(&low) > limit) more = add(low) || more;
    if (!more) break;
  }
  return out;
}

MinimumZone minimum_zone(const ZoneProblem& problem, Place at) {
  constexpr int kIterations = 50;
  MinimumZone out;
  const auto n = static_cast<Eigen::Index>(problem.size());
  Eigen::MatrixXd J(n, problem.columns());
  Eigen::VectorXd d(n);
  const auto width_at = [&](const Place& place) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (std::size_t i = 0; i < problem.size(); ++i) {
      const double x = problem.distance(place, i);
      low = std::min(low, x);
      high = std::max(high, x);
    }
    return high - low;
  };
  double width = width_at(at);
  for (;; ++out.iterations) {
    for (Eigen::Index i = 0; i < n; ++i) {
      J.row(i) = problem.row(at, static_cast<std::size_t>(i)).transpose();
      d[i] = problem.distance(at, static_cast<std::size_t>(i));
    }
    d.array() -= 0.5 * (d.minCoeff() + d.maxCoeff());  // of the radius (the offset), which is free
    const Active active = solve_all(J, d);
    bool better = false;
    Eigen::VectorXd x = active.solution.x;
    for (int halving = 0; !better && halving < 20; ++halving, x *= 0.5) {
      const Place trial = problem.moved(at, x);
      const double there = width_at(trial);
      better = there < width * (1.0 - 1e-14);
      if (!better) continue;
      at = trial;
      width = there;
    }
    if (better && out.iterations < kIterations) continue;
    out.width_mm = width;
    // What displacement is still open at this width; twice, for the remainder itself widens the room.
    double e = 0.0, w = 0.0, rest = 0.0;
    for (int pass = 0; pass < 3 && std::isfinite(rest); ++pass) {
      e = w = 0.0;
      const double room = 0.5 * width + rest + 1e-14;
      const int shifts = problem.shifts(), tilts = problem.tilts();
      for (int c = 0; c < shifts + tilts; ++c) {
        double reach = 0.0;
        for (const double sign : {1.0, -1.0}) {
          const auto far = farthest(active.J, active.d, room, sign * Eigen::VectorXd::Unit(problem.columns(), c));
          reach = std::max(reach, far.value_or(std::numeric_limits<double>::infinity()));
        }
        (c < shifts ? e : w) = std::hypot(c < shifts ? e : w, reach);
      }
      rest = problem.remainder(at, e, w);
    }
    out.lower_mm = std::isfinite(rest) ? std::max(0.0, std::min(width, 2.0 * active.solution.t - rest)) : 0.0;
    return out;
  }
}

Result<MinimumZone> solved(Zone zone, Points points_mm, const Eigen::Vector3d& center_mm, const Eigen::Matrix3d& axes) {
  double size = 0.0;
  for (const Eigen::Vector3d& p : points_mm) size = std::max(size, (p - center_mm).cwiseAbs().maxCoeff());
  std::vector<Eigen::Vector3d> points;
  points.reserve(points_mm.size());
  for (const Eigen::Vector3d& p : points_mm) points.push_back((p - center_mm) / size);
  MinimumZone out = minimum_zone(ZoneProblem(zone, std::move(points)), {Eigen::Vector3d::Zero(), axes});
  out.width_mm *= size;
  out.lower_mm *= size;
  return out;
}

}  // namespace

std::string why_not_one_surface(const char* shape, Points points_mm, const FitQuality& plain,
                                const FitQuality* robust) {
  constexpr double kCloud = 0.05, kTwoKinds = 5.0;
  const double s = plain.standard_deviation_mm;
  if (!std::isfinite(s)) return {};
  if (robust && robust->n_rejected > 0 && s > kTwoKinds * robust->standard_deviation_mm) {
    return fmt::format(
        "These points are not of one {}: they scatter {:.3g} mm about it, while {} of the {} lie on one of their own "
        "within "
        "{:.3g} mm (standard deviations); use --robust for that one, or `fringecal find` for every shape among them",
        shape, s, robust->n_used, points_mm.size(), robust->standard_deviation_mm);
  }
  const CentredPoints centre = centred(points_mm, {}, points_mm.size());
  if (s <= kCloud * centre.framed.scale_mm) return {};
  return fmt::format(
      "These points are hardly a {}: they scatter {:.3g} mm about it (standard deviation) and extend over {:.3g} mm "
      "(rms from "
      "their centroid); use `fringecal find` for the shapes among them, or --robust for the one most of them lie on",
      shape, s, centre.framed.scale_mm);
}

double narrowest_interval(std::span<const double> values, double share) {
  require(!values.empty() && share > 0.0 && share <= 1.0, "narrowest_interval() is given values and a share");
  std::vector<double> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  const auto n = static_cast<double>(sorted.size());
  const std::size_t held = std::min(sorted.size(), static_cast<std::size_t>(std::ceil(share * n - 1e-9)));
  double best = sorted.back() - sorted.front();
  for (std::size_t i = 0; i + held <= sorted.size(); ++i) best = std::min(best, sorted[i + held - 1] - sorted[i]);
  return best;
}

FormDeviation form_of(const FitQuality& quality) {
  require(quality.max_mm && quality.min_mm, "the form is taken of a fit with its distances");
  std::vector<double> used;
  for (std::size_t i = 0; i < quality.distances_mm.size(); ++i) {
    if (!quality.rejected[i]) used.push_back(quality.distances_mm[i]);
  }
  return {*quality.max_mm - *quality.min_mm, narrowest_interval(used, 0.95), quality.standard_deviation_mm};
}

Result<MinimumZone> flatness(Points points_mm) {
  const auto fit = fit_plane(points_mm);
  if (!fit) return tl::unexpected(fit.error());
  return solved(Zone::plane, points_mm, fit->point_mm, axes_with(fit->normal, 2));
}
Result<MinimumZone> sphericity(Points points_mm) {
  const auto fit = fit_sphere(points_mm);
  if (!fit) return tl::unexpected(fit.error());
  return solved(Zone::sphere, points_mm, fit->center_mm, Eigen::Matrix3d::Identity());
}
Result<MinimumZone> cylindricity(Points points_mm) {
  const auto fit = fit_cylinder(points_mm);
  if (!fit) return tl::unexpected(fit.error());
  return solved(Zone::cylinder, points_mm, fit->axis_point_mm, axes_with(fit->axis_direction, 2));
}
Result<MinimumZone> roundness(Points points_mm) {
  const auto fit = fit_circle(points_mm);
  if (!fit) return tl::unexpected(fit.error());
  return solved(Zone::circle, points_mm, fit->center_mm, axes_with(fit->normal, 2));
}

}  // namespace fringecal::fitting
