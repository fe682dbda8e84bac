// Spheres, cylinders and planes in a raw cloud, without help: hypotheses (hypotheses.h), then fits (fit.h) of the points
// that belong to each, cleaned by stated rules. Every point of the cloud gets one reason:
//   surface     used by the fit of its shape
//   margin      nearer than `margin_spacings` point distances (the cloud's median, stray points among them; where that
//               leaves too few points, the shape's own median) to a point that lies beside the shape's surface on
//               another one (a post, a base, a table: where two surfaces meet, a scanner's spot sees both); stray
//               points are on none (Neighbourhood::on_surface)                                                    (1)
//   silhouette  as near to the edge of the shape's points: a point whose neighbours on the shape (stray points left out)
//               leave a gap of more than 150 degrees around it (grazing views, half spots)                        (2)
//   beyond      more than 3.5 robust standard deviations from the surface (Rejection::robust)                    (3)
//   none        of no shape
// A shape whose scatter is more than 5 % of its extent is none. A hypothesis is fitted as each kind; the one of least
// scatter stands, the simpler where the other gains less than a tenth. With nominals, a shape gets the nominal of its kind
// nearest in size, within `max_size_error`; a nominal is given once, to the shape that is nearest. Up to 40 % of the points
// may be stray ones (tried), fewer than the shape's where they are. Points in mm; the order of the points decides nothing
// but ties.
#pragma once

#include "fitting/hypotheses.h"

#include <string>
#include <vector>

namespace fringecal::fitting {

enum class PointReason : std::uint8_t { none, surface, margin, silhouette, beyond };

struct NominalShape {
  std::string name;
  ShapeKind kind = ShapeKind::sphere;
  double diameter_mm = 0;  // ignored for a plane
};

struct FindOptions {
  std::size_t min_points = 200;
  double margin_spacings = 3.0;
  double max_size_error = 0.10;
};

struct FoundShape {
  ShapeKind kind = ShapeKind::plane;
  std::string nominal;        // its name, or empty
  Eigen::Vector3d place_mm;   // centre; point of the axis; centroid
  Eigen::Vector3d direction;  // of the axis, the normal; zero for a sphere
  double diameter_mm = 0, u_diameter_mm = 0;
  double standard_deviation_mm = 0;
  std::size_t n_surface = 0, n_margin = 0, n_silhouette = 0, n_beyond = 0;
};

struct FoundShapes {
  std::vector<FoundShape> shapes;  // by falling number of points
  std::vector<int> shape_of;       // per point: index into shapes, or -1
  std::vector<PointReason> reason;
};

/// No result: too few points, points that are not finite, or no shape among them.
Result<FoundShapes> find_shapes(Points points_mm, std::span<const NominalShape> nominals = {},
                                const FindOptions& options = {});

const char* name_of(ShapeKind kind);

}  // namespace fringecal::fitting
