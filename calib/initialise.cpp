#include "calib/initialise.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

#include <cmath>

namespace fringecal::calib {
namespace {

struct CvViews {
  std::vector<std::vector<cv::Point3f>> object;
  std::vector<std::vector<cv::Point2f>> image;
};

CvViews views_of(const Bundle& bundle) {
  CvViews v;
  v.object.resize(bundle.cam_from_board.size());
  v.image.resize(bundle.cam_from_board.size());
  for (const Sight& s : bundle.sights) {
    if (!s.used) continue;
    const auto pose = static_cast<std::size_t>(s.pose);
    const Eigen::Vector2d& t = bundle.targets_mm[static_cast<std::size_t>(s.target)];
    v.object[pose].emplace_back(static_cast<float>(t.x()), static_cast<float>(t.y()), 0.0F);
    v.image[pose].emplace_back(static_cast<float>(s.pixel.x()), static_cast<float>(s.pixel.y()));
  }
  return v;
}

/// Row of eq. 1 into the normal matrix of (m1, m2, m3); offset 0 for u, 4 for v.
void add_row(Eigen::MatrixXd& normal, int offset, const Eigen::Vector4d& point, double value) {
  Eigen::VectorXd row = Eigen::VectorXd::Zero(normal.rows());
  row.segment<4>(offset) = -point;
  row.tail<4>() = value * point;
  normal += row * row.transpose();
}

}  // namespace

Result<bool> initialise_camera(Bundle& bundle) {
  const CvViews views = views_of(bundle);
  const cv::Size size(bundle.camera.width_px, bundle.camera.height_px);
  const double side = std::max(size.width, size.height);
  double f = 0;
  try {
    f = cv::initCameraMatrix2D(views.object, views.image, size, 1.0).at<double>(0, 0);
  } catch (const cv::Exception&) {
    f = 0;
  }
  // Zhang's closed form needs tilted boards and gives anything for nearly parallel ones; a lens between wide angle and
  // long focus is a start from which the solve itself finds out what the boards say.
  if (!(f > 0.3 * side && f < 30.0 * side)) f = 2.0 * side;
  auto& c = bundle.camera;
  c.fx_px = c.fy_px = f;
  c.cx_px = 0.5 * (size.width - 1);
  c.cy_px = 0.5 * (size.height - 1);
  c.distortion = {};
  const cv::Matx33d matrix(f, 0, c.cx_px, 0, f, c.cy_px, 0, 0, 1);
  for (std::size_t pose = 0; pose < views.object.size(); ++pose) {
    cv::Mat rotation_vector, translation;
    bool found = false;
    if (views.object[pose].size() >= 4) {
      try {
        found =
            cv::solvePnP(views.object[pose], views.image[pose], matrix, cv::noArray(), rotation_vector, translation);
      } catch (const cv::Exception&) {
        found = false;
      }
    }
    Eigen::Vector3d w = Eigen::Vector3d::Zero(), t = Eigen::Vector3d::Zero();
    for (int i = 0; found && i < 3; ++i) {
      w[i] = rotation_vector.at<double>(i);
      t[i] = translation.at<double>(i);
    }
    if (!found || !w.allFinite() || !t.allFinite() || !(t.z() > 0.0)) {
      return unanswerable(
          fmt::format("no position of the board explains the corners of pose {}; check the board's "
                      "columns, rows and pitch",
                      pose + 1));
    }
    bundle.cam_from_board[pose] = {rotation_from_vector(w), t};
  }
  return true;
}

Result<bool> initialise_projector(Bundle& bundle) {
  auto& projector = *bundle.projector;
  const bool both = projector.x && projector.y;
  const CodeAxis main = projector.main_axis();
  // Conditioning as in [HartleyZisserman2004, 4.4]: centred points of unit spread, coordinates of unit spread.
  struct Row {
    Eigen::Vector3d point;
    std::optional<double> u, v;  // main axis, other axis
  };
  std::vector<Row> rows;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Vector2d coordinate_mean(0, 0), coordinate_count(0, 0);
  for (const Sight& s : bundle.sights) {
    const auto& u = main == CodeAxis::x ? s.x : s.y;
    const auto& v = main == CodeAxis::x ? s.y : s.x;
    if (!s.used || (!u && !(both && v))) continue;
    Row row;
    const Eigen::Vector2d& t = bundle.targets_mm[static_cast<std::size_t>(s.target)];
    row.point = bundle.cam_from_board[static_cast<std::size_t>(s.pose)] * Eigen::Vector3d(t.x(), t.y(), 0);
    if (u) row.u = u->value;
    if (both && v) row.v = v->value;
    mean += row.point;
    coordinate_mean += Eigen::Vector2d(row.u.value_or(0), row.v.value_or(0));
    coordinate_count += Eigen::Vector2d(row.u ? 1 : 0, row.v ? 1 : 0);
    rows.push_back(row);
  }
  const int unknowns = both ? 12 : 8;
  if (coordinate_count[0] < unknowns || (both && coordinate_count[1] < unknowns)) {
    return unanswerable(
        fmt::format("{:.0f} corners have a projector coordinate; at least {} are needed, light the board fully",
                    coordinate_count[0], unknowns));
  }
  mean /= static_cast<double>(rows.size());
  coordinate_mean = coordinate_mean.cwiseQuotient(coordinate_count.cwiseMax(1));
  double spread = 0;
  Eigen::Vector2d coordinate_spread(0, 0);
  for (const Row& r : rows) {
    spread += (r.point - mean).squaredNorm();
    if (r.u) coordinate_spread[0] += std::pow(*r.u - coordinate_mean[0], 2);
    if (r.v) coordinate_spread[1] += std::pow(*r.v - coordinate_mean[1], 2);
  }
  spread = std::sqrt(spread / static_cast<double>(rows.size()));
  coordinate_spread = coordinate_spread.cwiseQuotient(coordinate_count.cwiseMax(1)).cwiseSqrt();
  if (!(spread > 0) || !(coordinate_spread[0] > 0) || (both && !(coordinate_spread[1] > 0))) {
    return unanswerable("all corners have the same projector coordinate; check the pattern plan");
  }

  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
  for (const Row& r : rows) {
    const Eigen::Vector3d p = (r.point - mean) / spread;
    const Eigen::Vector4d point(p.x(), p.y(), p.z(), 1.0);
    if (r.u) add_row(normal, 0, point, (*r.u - coordinate_mean[0]) / coordinate_spread[0]);
    if (r.v) add_row(normal, 4, point, (*r.v - coordinate_mean[1]) / coordinate_spread[1]);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(normal);
  const Eigen::VectorXd solution = eigen.eigenvectors().col(0);
  // Back from the conditioned frame: m . (p, 1) with p = (X - mean) / spread.
  const auto restored = [&](const Eigen::Vector4d& m) {
    Eigen::Vector4d out;
    out.head<3>() = m.head<3>() / spread;
    out[3] = m[3] - m.head<3>().dot(mean) / spread;
    return out;
  };
  Eigen::Vector4d m3 = restored(solution.tail<4>());
  Eigen::Vector4d m1 = coordinate_spread[0] * restored(solution.head<4>()) + coordinate_mean[0] * m3;
  Eigen::Vector4d m2 = Eigen::Vector4d::Zero();
  if (both) m2 = coordinate_spread[1] * restored(solution.segment<4>(4)) + coordinate_mean[1] * m3;
  // Points lie in front of the projector.
  const double sign = m3.head<3>().dot(mean) + m3[3] < 0 ? -1.0 : 1.0;
  const double norm = sign * m3.head<3>().norm();
  m1 /= norm;
  m2 /= norm;
  m3 /= norm;
  const Eigen::Vector3d r3 = m3.head<3>();
  const double u0 = m1.head<3>().dot(r3);
  const double f = (m1.head<3>() - u0 * r3).norm();
  const Eigen::Vector3d across = (m1.head<3>() - u0 * r3) / f;
  const double t_across = (m1[3] - u0 * m3[3]) / f;
  // Right-handed: (x, y, z) with x the main axis, or (x, y, z) with y the main axis.
  const Eigen::Vector3d along = main == CodeAxis::x ? r3.cross(across) : across.cross(r3);
  double t_along = 0;
  if (both) {
    const double v0 = m2.head<3>().dot(r3);
    const double fv = (m2.head<3>() - v0 * r3).dot(along);  // negative on a mirrored display
    t_along = (m2[3] - v0 * m3[3]) / fv;
    auto& other = main == CodeAxis::x ? projector.y : projector.x;
    other->f = fv;
    other->u0 = v0;
  }
  auto& axis = main == CodeAxis::x ? projector.x : projector.y;
  axis->f = f;
  axis->u0 = u0;
  projector.distortion = {};
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
  if (main == CodeAxis::x) {
    rotation << across.transpose(), along.transpose(), r3.transpose();
    translation = {t_across, t_along, m3[3]};
  } else {
    rotation << along.transpose(), across.transpose(), r3.transpose();
    translation = {t_along, t_across, m3[3]};
  }
  if (!rotation.allFinite() || !translation.allFinite() || !(f > 0) || !std::isfinite(u0)) {
    return unanswerable(
        "the corners do not determine the projector: boards that are parallel, or too alike; capture the "
        "board tilted by 20 to 40 degrees about different axes and at different distances");
  }
  bundle.proj_from_cam = {Eigen::Quaterniond(rotation).normalized(), translation};
  return true;
}

}  // namespace fringecal::calib
