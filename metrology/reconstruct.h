// From a phase map and a Scanner file to points: the full ray model, and the paper's closed form beside it.
//
// full      The camera pixel gives a ray x(l) = l r in cam (camera.h); the phase gives u (pattern_plan.h); the point is
// where
//           the projector model (projector.h, eq. 1) says u. One unknown l, solved by Newton from the undistorted plane
//           of light; r, u and the projector's distortion are taken at the point itself, nothing is approximated. u(l)
//           = |du/dl|^-1 (p / 2 pi) u(phi).
// chen2008  Eqs. 1 to 17 of the paper with eqs. 18 to 20 for both lenses (calib/model/chen2008.h).
// ideal     Eqs. 1 to 17 alone: no lens distortion. For comparison only.
#pragma once

#include "calib/decode/decode.h"
#include "calib/model/scanner.h"
#include "metrology/point_cloud.h"

namespace fringecal::metrology {

enum class ReconstructionModel { full, chen2008, ideal };

struct ReconstructOptions {
  ReconstructionModel model = ReconstructionModel::full;
  double max_u_along_ray_mm = 1.0;  // a pixel noisier than this along its ray is left out
  int edge_margin_px = 2;  // pixels this near to an invalid one are left out: blur mixes foreground and background
  bool normals = true;
};

struct Reconstruction {
  PointCloud cloud;
  std::size_t n_invalid = 0, n_noisy = 0, n_edge = 0, n_no_intersection = 0;  // left out, by name
};

Reconstruction reconstruct(const decode::PhaseMap& map, const model::Scanner& scanner,
                           const ReconstructOptions& options = {});

}  // namespace fringecal::metrology
