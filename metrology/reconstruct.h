// From a phase map and a Scanner file to points: the full ray model, and the paper's closed form beside it.
//
// full      The camera pixel gives a ray x(l) = l r in cam (camera.h); the phase gives u (pattern_plan.h); the point is
//           where the projector model (projector.h, eq. 1) says u: calib/model/triangulate.h, of many pixels at once by
//           triangulate_span.h over a table with the ray of every pixel. Nothing is approximated or interpolated.
//             u(l) = |du/dl|^-1 (p / 2 pi) u(phi),  l in mm along the ray                                         (1)
// chen2008  Eqs. 1 to 17 of the paper with eqs. 18 to 20 for both lenses (calib/model/chen2008.h).
// ideal     Eqs. 1 to 17 alone: no lens distortion. For comparison only; (1) is that of the full model in both.
//           Both take the parameters that were fitted to this scanner (Scanner::paper_model, paper_ideal_model), each
//           its own; where the file has none, the geometric ones (chen2008_from).
//
// Left out, and counted by the first reason that holds: pixels without phase; pixels whose ray does not meet the
// plane of light; pixels at an edge, that is within `edge_margin_px` of one of these or of a jump in depth to a
// neighbour; pixels of low modulation, where more is asked for than the decoding does; isolated ones, that is of a piece of
// connected neighbours (left, right, above, below, no jump between) that has fewer than `min_piece` points; noisy pixels;
// grazing ones, where that is asked for. A jump: neighbouring pixels whose points are farther apart than kMaxStep = 6 pixel
// footprints (a surface seen at 80 degrees from its normal) and than six standard uncertainties.
// Normal: n ~ dP/dx x dP/dy, the two slopes fitted to the points of the 5 x 5 neighbourhood that connect without
// jump; at least 13 of them, else zero.                                                                           (2)
// Points in `world`, mm, row by row whatever the thread count. Map and scanner that do not belong together (size,
// axis, code): InputError.
#pragma once

#include "calib/decode/decode.h"
#include "calib/model/scanner.h"
#include "metrology/point_cloud.h"

#include <memory>
#include <optional>

namespace fringecal::metrology {

enum class ReconstructionModel { full, chen2008, ideal };

struct ReconstructOptions {
  ReconstructionModel model = ReconstructionModel::full;
  double max_u_along_ray_mm = 1.0;  // a pixel noisier than this along its ray is left out
  int edge_margin_px = 2;     // pixels this near to an invalid one are left out: blur mixes foreground and background
  double min_modulation = 0;  // grey levels of the capture; the decoding itself leaves out what is below 4 of 255
  int min_piece = 1;          // points; a speck of dust or a reflection is a piece of its own. 1: none is left out
  /// Points whose normal stands farther than this from the camera or from the light are left out: there the light is weak
  /// and noise grows with 1 / cos^2. Needs normals; a point without one stays. Absent: none.
  std::optional<double> max_incidence_deg = std::nullopt;
  bool normals = true;
};

struct Reconstruction {
  PointCloud cloud;
  std::size_t n_invalid = 0, n_noisy = 0, n_edge = 0, n_no_intersection = 0, n_grazing = 0,  // left out, by name
      n_low_modulation = 0, n_isolated = 0;
};

/// What stays the same from map to map of one scanner: the rays of its pixels and, once asked for, the phase of its
/// reference plane; and memory that is used again. For one caller at a time.
class Reconstructor {
 public:
  explicit Reconstructor(const model::Scanner& scanner);
  ~Reconstructor();
  /// earlier: a reconstruction whose memory is taken.
  Reconstruction operator()(const decode::PhaseMap& map, const ReconstructOptions& options = {},
                            Reconstruction earlier = {});

 private:
  struct Tables;
  std::unique_ptr<Tables> tables_;
};

/// The same for a single map.
Reconstruction reconstruct(const decode::PhaseMap& map, const model::Scanner& scanner,
                           const ReconstructOptions& options = {});

}  // namespace fringecal::metrology
