// Form deviations by the standards' names, and minimum zones.
//
// From the distances d_i of a Gaussian fit (fit.h):
//   range = max d - min d;  95 % shell: the narrowest interval that holds 95 % of the d_i;  sd = sqrt(F / (n - m))   (1)
// Sphere: P_Form.Sph.1x25 is the range of 25 probed points, P_Form.Sph.D95% the shell of a scan [ISO10360-8]; plate:
// E_Form.Pla.D95%, its shell. sd: the form standard deviation of [Chen2008, section 4].
//
// Minimum zone: the surface of least T = max d - min d over all positions: FLTt [ISO12781-1], RONt [ISO12181-1], CYLt
// [ISO12180-1], and sphericity. From the Gaussian fit on, the linear programme
//   minimise t  subject to  |d_i + J_i x| <= t for all i                                                         (2)
// is solved exactly (CGAL's solver in rational arithmetic, over the few points that matter) and the surface moved by x,
// until that gains nothing. Each solution bounds the zone from below: a displacement by (e, w) of the centre or axis
// changes d_i by J_i x up to a remainder between 0 and
//   R = (|e| + |w| h)^2 / (2 (rho - |e| - |w| h)) + 2 |w|^2 (rho + h)                                              (3)
// rho the least distance of a point from the centre or axis, h the largest height along the axis. So no surface within
// (e, w) has a T below 2 t - R. The displacements that (2) leaves open at T = upper bound follow from the same programme
// with other objectives; lower_mm is the bound for these. For a plane (3) is zero up to the cosine of the tilt.
#pragma once

#include "core/result.h"
#include "fitting/fit.h"

#include <span>
#include <string>

namespace fringecal::fitting {

struct FormDeviation {
  double range_mm = 0, shell_95_mm = 0, standard_deviation_mm = 0;  // eq. 1
};

/// Of the points used by a fit of a surface (plane, sphere, cylinder) with its distances.
FormDeviation form_of(const FitQuality& quality);

/// The narrowest interval that holds the share (0..1] of the values; at least one value.
double narrowest_interval(std::span<const double> values, double share);

/// A sentence where the points of a plain fit are not of one surface, else empty: they scatter more than 5 % of their
/// extent about it (the rule of find.h), or more than five times as much as most of them, `robust`, about a surface of
/// their own (form deviations of one surface and noise of any usual distribution stay below twice).
std::string why_not_one_surface(const char* shape, Points points_mm, const FitQuality& plain, const FitQuality* robust);

struct MinimumZone {
  double width_mm = 0;  // T of the surface found: an upper bound of the zone
  double lower_mm = 0;  // nothing near that is below; within 1e-9 mm of width_mm for ordinary data
  int iterations = 0;
};

/// No result: where the Gaussian fit gives none. At least one point more than parameters.
Result<MinimumZone> flatness(Points points_mm);
Result<MinimumZone> sphericity(Points points_mm);
Result<MinimumZone> cylindricity(Points points_mm);
/// Of a section: the points projected into the plane of their Gaussian circle.
Result<MinimumZone> roundness(Points points_mm);

}  // namespace fringecal::fitting
