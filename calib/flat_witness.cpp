#include "calib/flat_witness.h"

#include "calib/board_detection.h"
#include "calib/decode/corrections.h"
#include "calib/model/triangulate.h"
#include "fitting/fit.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace fringecal::calib {
namespace {

// Some 600 windows of a period on a camera of 1.4 million pixels: a third of its pixels, each once.
constexpr int kColumns = 29;
constexpr std::size_t kFewest = 100;

}  // namespace

double u_flatness_mm(double certified_flatness_mm) { return certified_flatness_mm / std::sqrt(3.0); }

Result<model::BoardObservation> observe_flat(const Capture& capture, const std::string& name,
                                             const model::PhaseLinearisation* table) {
  model::BoardObservation out{name, {}};
  const int step = std::max(8, capture.info.width_px / kColumns), half = step / 2;
  for (int row = 0; half + row * step < capture.info.height_px; ++row) {
    for (int column = 0; half + column * step < capture.info.width_px; ++column) {
      model::CornerObservation cell;
      cell.column = column;
      cell.row = row;
      cell.pixel = {half + column * step, half + row * step};
      out.corners.push_back(cell);
    }
  }
  for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
    if (!capture.info.plan.code(axis)) continue;
    const auto* own = table && table->axis == axis ? table : nullptr;
    add_projector_coordinates(out, decode::decode_for_measuring(capture, axis, own).map);
  }
  const std::size_t asked = out.corners.size();
  std::erase_if(out.corners, [](const auto& c) { return !c.x && !c.y; });
  if (out.corners.size() < kFewest) {
    return unanswerable(fmt::format(
        "fringes are read at {} of {} places; put a white flat plate where it fills the field and check the exposure",
        out.corners.size(), asked));
  }
  return out;
}

Result<void> add_flats(Bundle& bundle, std::span<const model::BoardObservation> flats) {
  const CodeAxis axis = bundle.projector->main_axis();
  double largest = 0;
  for (const auto& flat : flats) {
    std::vector<Eigen::Vector3d> points;
    for (const auto& cell : flat.corners) {
      const auto& u = axis == CodeAxis::x ? cell.x : cell.y;
      if (!u) continue;
      const auto at =
          model::triangulate(bundle.camera, *bundle.projector, bundle.proj_from_cam, axis, cell.pixel, u->value);
      if (at) points.push_back(*at);
    }
    const auto plane = fitting::fit_plane(points);
    if (!plane) return unanswerable(fmt::format("{}: {}", flat.name, plane.error().sentence));
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const auto& p : points) middle += p / static_cast<double>(points.size());
    for (const auto& p : points) largest = std::max(largest, (p - middle).norm());
    // z away from the camera, x as nearly as can be with the image's: so the bow's axes are the plate's in every view.
    const Eigen::Vector3d z = plane->normal.z() < 0 ? Eigen::Vector3d(-plane->normal) : plane->normal;
    const Eigen::Vector3d x = (Eigen::Vector3d::UnitX() - z.x() * z).normalized();
    Eigen::Matrix3d axes;
    axes << x, z.cross(x), z;
    const int pose = static_cast<int>(bundle.cam_from_board.size());
    bundle.cam_from_board.push_back({Eigen::Quaterniond(axes).normalized(), middle});
    for (const auto& cell : flat.corners) {
      bundle.sights.push_back({pose, kOnFlat, cell.pixel, 1.0, cell.x, cell.y, true});
    }
  }
  bundle.flats += static_cast<int>(flats.size());
  if (!flats.empty()) bundle.flat_half_mm = largest;
  return {};
}

}  // namespace fringecal::calib
