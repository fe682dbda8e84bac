// Views of one object brought into one frame, `part`, which is that of the first view.
//
// Reference spheres first. c_ij is the centre of sphere j in view i. Which centre is which sphere follows from their mutual
// distances, which a motion keeps: view after view is joined to those joined already by the motion that brings most of its
// centres onto known ones within `match_mm`, at least three and not on a line.
//   min over T_i, X_j of  sum |T_i c_ij - X_j|^2,  T_0 = 1                                                        (1)
// Then the surface, all views and all pairs that overlap at once:
//   min over T_i of  sum w r^2 / (s u)^2 + sum |T_i c_ij - X_j|^2 / s_c^2,   r = n . (T_a p - T_b q)               (2)
//   u^2 = (u_p n . l_p)^2 + (u_q n . l_q)^2 / neighbours                                                          (3)
// where q is the mean of the `neighbours` points of view b nearest to p, n their mean normal in `part`, u_p and u_q the points'
// own standard uncertainties along the camera's rays l, w Tukey's weight of r / (s u), s the robust standard deviation of r / u,
// s_c that of the centres. Clouds without uncertainties: u = 1 mm for all.
// Grazing points do not take part: those whose normal stands farther than max_incidence_deg from the camera or from the
// light, a rule of the kind that artefacts are evaluated by (artefact.h, eq. 2), where the view says where these stand. The modulation of a
// matt surface falls with the cosine of the light's incidence and u(phi) grows with its inverse, so that without this rule the
// rim of a body, seen at up to 80 degrees by one view of every pair, decides the standard deviation. Pairs farther apart than max_pair_mm, or whose normals differ by
// more than 45 degrees, do not count. Gauss-Newton; nearest points are searched anew in each iteration.
// Averaging over neighbours takes b's noise out of r; on a surface of radius R it shifts q by about a^2 / (4 R), a the
// neighbourhood's radius (1 um for 0.6 mm and 90 mm).
//
// Residuals of a pair of views, over its pairs of points with w > 0: mean of r, standard deviation of r. As the paper
// reports them: the mean of |mean| and the mean of the standard deviations over all pairs of views. [Chen2008, section 4]
// Points in mm. Views that share too few spheres with the others: no result, with the view's name.
#pragma once

#include "core/result.h"
#include "core/rigid.h"
#include "metrology/point_cloud.h"

#include <Eigen/Core>

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fringecal::metrology {

struct View {
  std::string name;
  PointCloud cloud;                         // with normals
  std::vector<Eigen::Vector3d> spheres_mm;  // centres of the reference spheres that it sees, in any order
  struct Pupils {
    Eigen::Vector3d camera_mm, light_mm;
  };
  std::optional<Pupils> pupils = {};  // in the view's frame; absent: no point is told to be grazing
};

struct RegistrationOptions {
  double match_mm = 0.3;     // of centres: far above their uncertainty, far below the distance of two spheres
  double max_pair_mm = 1.0;  // after the spheres, views are within some 0.05 mm of each other
  int samples_per_view = 5000;
  int neighbours = 12;
  int max_iterations = 30;
  double max_incidence_deg =
      70;              // u has grown threefold there; nearer to 60, views a quarter turn apart share no point
  bool refine = true;  // eq. 2 after eq. 1
};

struct PairResiduals {
  std::size_t a = 0, b = 0;  // views
  std::size_t n_points = 0;
  double mean_mm = 0, sd_mm = 0;
  double noise_mm = 0;  // root mean square of eq. 3: what the points' own noise makes of sd; 0 where clouds have no u
};

struct Registration {
  std::vector<Rigid3> part_from_view;
  std::vector<Eigen::Vector3d> spheres_mm;  // X_j in `part`
  double sphere_rms_mm = 0;                 // sqrt(mean |T_i c_ij - X_j|^2), after all
  std::vector<PairResiduals> pairs;         // those with at least 100 pairs of points
  double mean_deviation_mm = 0, mean_sd_mm = 0, mean_noise_mm = 0;
  std::vector<std::size_t> n_grazing;  // of each view, left out of eq. 2
  int iterations = 0;                  // of eq. 2
};

Result<Registration> register_views(std::span<const View> views, const RegistrationOptions& options = {});

/// All points in `part`, view after view; pixels are kept, so they no longer name a place in one image.
PointCloud merged(std::span<const View> views, const Registration& registration);

}  // namespace fringecal::metrology
