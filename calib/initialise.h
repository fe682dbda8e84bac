// The start of the joint solve, linear: camera by Zhang's closed form with the principal point in the middle, poses
// from homographies, projector by a direct linear transformation from the board points in cam.
//
// With X a point in cam and M the projector's matrix, rows m1, m2, m3 of four,
//   u (m3 . X) - m1 . X = 0,   v (m3 . X) - m2 . X = 0                                                (1)
// and m3 = (r3, t3), m1 = f_x (r1, t1) + u0_x m3: a projector that is coded along one axis has (1) without the other
// line. Then f_x = |m1 - (m1 . r3) r3| over the first three entries, u0_x = m1 . r3, and r2 = r3 x r1. The place along
// the fringes does not enter; it starts at 0. Along y alone the same with r1 = r2 x r3. f of the main axis is positive.
// [Zhang2000] [HartleyZisserman2004, ch. 7]
#pragma once

#include "calib/joint_solve.h"

namespace fringecal::calib {

/// Fills in camera (without distortion) and poses. No result: poses that no camera explains.
Result<bool> initialise_camera(Bundle& bundle);

/// Fills in projector.x/y f and u0 (the codes must be set) and proj_from_cam, from the camera and poses of the bundle.
Result<bool> initialise_projector(Bundle& bundle);

}  // namespace fringecal::calib
