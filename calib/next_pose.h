// Where to hold the board next: the pose that lowers the worst uncertainty in the volume most.
//
// With C the Scanner's covariance, a further pose with the information I (its readings with the uncertainties of the poses so
// far; its own attitude, place, phase offset and bending eliminated, bundle_system.h, eq. 1) leaves
//   C' = (C^-1 + I)^-1,   worst = max over points of sqrt(trace(J C' J^T))                                       (1)
// J the derivatives of the volume's points (metrology/volume.h). Candidates: the board facing the camera or turned about the
// image's x or y axis by 25 or 40 degrees either way, its middle on a grid of 3 x 3 x 3 places over the image and the heights;
// those that show at least half of the corners to camera and fringes. Held at their estimate: the board's scale, bow and
// printing, of which a further pose tells more than is counted here. mm, rad. No result: a Scanner without observations, or
// whose covariance cannot be inverted; no candidate that is seen.
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"

#include <Eigen/Core>

#include <string>
#include <vector>

namespace fringecal::calib {

struct ProposedPose {
  Eigen::Vector3d middle_in_world_mm = Eigen::Vector3d::Zero();
  double about_x_deg = 0, about_y_deg = 0;  // turned about the image's axes from facing the camera
  int corners = 0;                          // seen by both
  double worst_mm = 0;                      // eq. 1, expected
};

struct NextPose {
  double worst_now_mm = 0;
  std::vector<ProposedPose> best;  // the best first, at most five
};

/// by: J of eq. 1, three rows per point. heights: lowest and highest Z of the volume, world.
Result<NextPose> propose_next_pose(const model::Scanner& scanner, const Eigen::MatrixXd& by,
                                   std::pair<double, double> heights_mm);
std::string words_of(const ProposedPose& pose, double worst_now_mm);

}  // namespace fringecal::calib
