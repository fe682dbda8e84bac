#include "fitting/check_fits.h"

#include "core/rigid.h"
#include "fitting/least_squares.h"
#include "fitting/rejection.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace fringecal::fitting {
namespace {

using Cloud = std::vector<Eigen::Vector3d>;

double uniform(Random& random) { return static_cast<double>(random.next() >> 11) * 0x1p-53; }
Eigen::Vector3d direction(Random& random) {
  const double z = 2.0 * uniform(random) - 1.0, turn = 2.0 * std::numbers::pi * uniform(random);
  const double across = std::sqrt(1.0 - z * z);
  return {across * std::cos(turn), across * std::sin(turn), z};
}

enum class Kind { plane, sphere, cylinder };

/// What a case is made of. angle: half-angle of the cap, whole angle of the sector; of a plane the aspect of its sides.
struct Condition {
  Kind kind;
  const char* name;
  double angle_deg;
  int points;
  double offset_mm;
  double radius_mm;
};

constexpr Condition kConditions[] = {
    {Kind::plane, "square, 1000 points", 1, 1000, 0, 100},
    {Kind::plane, "3 points", 1, 3, 0, 100},
    {Kind::plane, "aspect 1000", 1000, 1000, 0, 100},
    {Kind::plane, "1e6 mm from the origin", 1, 1000, 1e6, 100},
    {Kind::plane, "of 1 um", 1, 1000, 0, 1e-3},
    {Kind::plane, "of 100 m", 1, 1000, 0, 1e5},
    {Kind::sphere, "whole, 1000 points", 180, 1000, 0, 25},
    {Kind::sphere, "hemisphere, 1000 points", 90, 1000, 0, 25},
    {Kind::sphere, "hemisphere, 4 points", 90, 4, 0, 25},
    {Kind::sphere, "hemisphere, 25 points", 90, 25, 0, 25},
    {Kind::sphere, "cap of 30 degrees", 15, 1000, 0, 25},
    {Kind::sphere, "cap of 10 degrees", 5, 1000, 0, 25},
    {Kind::sphere, "cap of 5 degrees", 2.5, 1000, 0, 25},
    {Kind::sphere, "1e6 mm from the origin", 90, 1000, 1e6, 25},
    {Kind::sphere, "of 1 um", 90, 1000, 0, 1e-3},
    {Kind::sphere, "of 100 m", 90, 1000, 0, 1e5},
    {Kind::sphere, "hemisphere, 100000 points", 90, 100000, 0, 25},
    {Kind::cylinder, "whole, 1000 points", 360, 1000, 0, 25},
    {Kind::cylinder, "half, 1000 points", 180, 1000, 0, 25},
    {Kind::cylinder, "half, 25 points", 180, 25, 0, 25},
    {Kind::cylinder, "sector of 30 degrees", 30, 1000, 0, 25},
    {Kind::cylinder, "sector of 10 degrees", 10, 1000, 0, 25},
    {Kind::cylinder, "1e6 mm from the origin", 180, 1000, 1e6, 25},
    {Kind::cylinder, "of 1 um", 180, 1000, 0, 1e-3},
    {Kind::cylinder, "of 100 m", 180, 1000, 0, 1e5},
    {Kind::cylinder, "half, 100000 points", 180, 100000, 0, 25},
};

struct Case {
  Cloud points_mm;
  Eigen::Vector3d place_mm, axis;  // centre; point and direction of the axis; point and normal
  double radius_mm = 0;
};

Case make_case(const Condition& c, Random& random) {
  Case out;
  const double r = c.radius_mm;
  out.place_mm = c.offset_mm * direction(random);
  out.axis = direction(random);
  out.radius_mm = r;
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), out.axis);
  const int n = c.points, m = c.kind == Kind::plane ? 3 : c.kind == Kind::sphere ? 4 : 5;
  const double angle = c.angle_deg * std::numbers::pi / 180.0;
  Cloud places, normals;
  Eigen::MatrixXd J(n, m);  // lengths in units of r
  double amplitude = 0.0;
  for (int i = 0; i < n; ++i) {
    Eigen::Vector3d u, normal;
    if (c.kind == Kind::plane) {
      u = {2.0 * uniform(random) - 1.0, (2.0 * uniform(random) - 1.0) / c.angle_deg, 0.0};
      normal = Eigen::Vector3d::UnitZ();
      J.row(i) << 1.0, u.x(), u.y() * c.angle_deg;
      amplitude = 0.01 / c.angle_deg;
    } else if (c.kind == Kind::sphere) {
      const double z = 1.0 - (1.0 - std::cos(angle)) * uniform(random), a = 2.0 * std::numbers::pi * uniform(random);
      const double across = std::sqrt(std::max(0.0, 1.0 - z * z));
      u = normal = {across * std::cos(a), across * std::sin(a), z};
      const double height = 1.0 - std::cos(std::min(angle, 0.5 * std::numbers::pi));
      // The columns so scaled that none is lost against another on a small cap.
      J.row(i) << 1.0, u.x() / std::sin(std::min(angle, 1.0)), u.y() / std::sin(std::min(angle, 1.0)),
          (1.0 - z) / height;
      amplitude = 0.02 * height;
    } else {
      const double a = angle * (uniform(random) - 0.5), z = 2.0 * uniform(random) - 1.0;
      normal = {std::cos(a), std::sin(a), 0.0};
      u = normal + z * Eigen::Vector3d::UnitZ();
      const double half = std::min(0.5 * angle, 0.5 * std::numbers::pi), height = 1.0 - std::cos(half);
      const double x = (1.0 - normal.x()) / height, y = normal.y() / std::sin(half);
      // radius and shift to the middle (1 and 1 - cos), and the tilts: z cos a = z - z (1 - cos a) and z sin a
      J.row(i) << 1.0, x, y, z * normal.x(), z * y;
      amplitude = 0.02 * height;
    }
    places.push_back(u);
    normals.push_back(normal);
  }
  Eigen::VectorXd e(n);
  for (int i = 0; i < n; ++i) e[i] = amplitude * (2.0 * uniform(random) - 1.0);
  if (n <= m) {
    e.setZero();
  } else {
    const Eigen::MatrixXd JtJ = J.transpose() * J;
    const Eigen::LDLT<Eigen::MatrixXd> solver(JtJ);
    for (int pass = 0; pass < 3; ++pass) e -= J * solver.solve(J.transpose() * e);  // eq. 1, again for its rounding
  }
  for (int i = 0; i < n; ++i) {
    out.points_mm.push_back(out.place_mm + r * (turn * (places[static_cast<std::size_t>(i)] +
                                                        e[i] * normals[static_cast<std::size_t>(i)])));
  }
  return out;
}

struct Deviation {
  double position = 0, direction = 0, size = 0;
};
double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return a.cross(b).norm() / (a.norm() * b.norm());
}

Deviation from(const PlaneFit& fit, const Eigen::Vector3d& place, const Eigen::Vector3d& axis) {
  return {std::abs(fit.normal.dot(place - fit.point_mm)), angle_between(axis, fit.normal), 0.0};
}
Deviation from(const SphereFit& fit, const Eigen::Vector3d& place, double diameter_mm) {
  return {(fit.center_mm - place).norm(), 0.0, std::abs(fit.diameter_mm - diameter_mm)};
}
Deviation from(const CylinderFit& fit, const Eigen::Vector3d& place, const Eigen::Vector3d& axis, double diameter_mm) {
  return {fit.axis_direction.cross(place - fit.axis_point_mm).norm(), angle_between(axis, fit.axis_direction),
          std::abs(fit.diameter_mm - diameter_mm)};
}

Result<Deviation> deviation_of(Kind kind, const Case& c) {
  if (kind == Kind::plane)
    return fit_plane(c.points_mm).map([&](const PlaneFit& f) { return from(f, c.place_mm, c.axis); });
  if (kind == Kind::sphere) {
    return fit_sphere(c.points_mm).map([&](const SphereFit& f) { return from(f, c.place_mm, 2.0 * c.radius_mm); });
  }
  return fit_cylinder(c.points_mm).map([&](const CylinderFit& f) {
    return from(f, c.place_mm, c.axis, 2.0 * c.radius_mm);
  });
}

}  // namespace

std::vector<CheckedClass> check_fits(const CheckOptions& options) {
  constexpr const char* kNames[] = {"plane", "sphere", "cylinder"};
  constexpr double kScale_mm = 25.0;
  std::vector<CheckedClass> out;
  Random random(options.seed);
  for (const Condition& condition : kConditions) {
    CheckedClass checked{kNames[static_cast<int>(condition.kind)], condition.name};
    checked.cases = condition.points > 10000 ? std::min(options.cases_per_class, 3) : options.cases_per_class;
    const double unit = kScale_mm / condition.radius_mm;
    const double rounding = std::numeric_limits<double>::epsilon() * (condition.offset_mm + condition.radius_mm);
    for (int i = 0; i < checked.cases; ++i) {
      const auto deviation = deviation_of(condition.kind, make_case(condition, random));
      if (!deviation) {
        ++checked.refused;
        continue;
      }
      checked.position_mm = std::max(checked.position_mm, unit * deviation->position);
      checked.direction_rad = std::max(checked.direction_rad, deviation->direction);
      checked.size_mm = std::max(checked.size_mm, unit * deviation->size);
      checked.roundings = std::max({checked.roundings, deviation->position / rounding, deviation->size / rounding});
    }
    out.push_back(std::move(checked));
  }
  return out;
}

CheckedPair check_pair(const std::string& name, Points points_mm, const std::vector<double>& reference) {
  CheckedPair out{name};
  const auto three = [&](std::size_t i) { return Eigen::Vector3d(reference[i], reference[i + 1], reference[i + 2]); };
  Result<Deviation> deviation = unanswerable("a reference has 4, 6 or 7 figures");
  if (reference.size() == 6) {
    out.shape = "plane";
    deviation = fit_plane(points_mm).map([&](const PlaneFit& f) { return from(f, three(0), three(3)); });
  } else if (reference.size() == 4) {
    out.shape = "sphere";
    deviation = fit_sphere(points_mm).map([&](const SphereFit& f) { return from(f, three(0), reference[3]); });
  } else if (reference.size() == 7) {
    out.shape = "cylinder";
    deviation =
        fit_cylinder(points_mm).map([&](const CylinderFit& f) { return from(f, three(0), three(3), reference[6]); });
  }
  if (!deviation) {
    out.failure = deviation.error().sentence;
    return out;
  }
  out.position_mm = deviation->position;
  out.direction_rad = deviation->direction;
  out.size_mm = deviation->size;
  return out;
}

}  // namespace fringecal::fitting
