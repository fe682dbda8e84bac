// The residuals of the joint solve (calibrate.h, eqs. 1 and 2) as templates: T is double or an
// automatic-differentiation type, so this header needs no solver.
//
// The place of a corner on its board, in frame `board`, mm:
//   X = (1 + s) (x + ex),  Y = (1 + s) (y + ey),  Z = b_x xi^2 + b_y eta^2                                  (1)
// (x, y) nominal, s the relative error of the pitch, (ex, ey) the printing error of this corner, the same in every
// pose, b_x and b_y the bow of the board, xi and eta the corner's place from the middle in half sides of the field. A
// rotation is exp(w) R with R fixed and w the parameter: the perturbation on the left that scanner.h speaks of. Every
// functor returns false for a point that is not in front of the lens.
#pragma once

#include "calib/model/camera.h"
#include "core/rigid.h"

#include <Eigen/Core>

#include <cmath>

namespace fringecal::calib::bundle {

/// exp(w) p, Rodrigues' formula; at w = 0 its first-order form, whose derivative is the exact one.
template <class T>
void rotate(const T* w, const T p[3], T out[3]) {
  using std::cos;
  using std::sin;
  using std::sqrt;
  const T theta2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
  const T cross[3] = {w[1] * p[2] - w[2] * p[1], w[2] * p[0] - w[0] * p[2], w[0] * p[1] - w[1] * p[0]};
  if (theta2 > T(1e-24)) {
    const T theta = sqrt(theta2);
    const T a = sin(theta) / theta, c = cos(theta);
    const T dot = (w[0] * p[0] + w[1] * p[1] + w[2] * p[2]) * (T(1.0) - c) / theta2;
    for (int i = 0; i < 3; ++i) out[i] = p[i] * c + cross[i] * a + w[i] * dot;
  } else {
    for (int i = 0; i < 3; ++i) out[i] = p[i] + cross[i];
  }
}

/// exp(w) R p + t.
template <class T>
void move(const Eigen::Matrix3d& fixed, const T* w, const T* t, const T p[3], T out[3]) {
  T turned[3];
  for (int i = 0; i < 3; ++i) turned[i] = T(fixed(i, 0)) * p[0] + T(fixed(i, 1)) * p[1] + T(fixed(i, 2)) * p[2];
  rotate(w, turned, out);
  for (int i = 0; i < 3; ++i) out[i] += t[i];
}

/// The corner in frame board, eq. 1.
struct BoardPlace {
  Eigen::Vector2d nominal_mm;
  Eigen::Vector2d from_middle;  // (xi, eta)

  template <class T>
  void operator()(const T* scale, const T* bow, const T* print, T out[3]) const {
    out[0] = (T(1.0) + scale[0]) * (T(nominal_mm.x()) + print[0]);
    out[1] = (T(1.0) + scale[0]) * (T(nominal_mm.y()) + print[1]);
    out[2] = bow[0] * T(from_middle.x() * from_middle.x()) + bow[1] * T(from_middle.y() * from_middle.y());
  }
};

/// calibrate.h, eq. 1: two residuals.
struct CameraResidual {
  BoardPlace place;
  const Eigen::Matrix3d* pose_rotation;
  Eigen::Vector2d pixel;
  double u_px;

  template <class T>
  bool operator()(const T* focal_center, const T* distortion, const T* w, const T* t, const T* scale, const T* bow,
                  const T* print, T* residual) const {
    T board[3], cam[3], xd, yd;
    place(scale, bow, print, board);
    move(*pose_rotation, w, t, board, cam);
    if (!(cam[2] > T(0.0))) return false;
    model::distort(distortion, T(cam[0] / cam[2]), T(cam[1] / cam[2]), xd, yd);
    residual[0] = (focal_center[0] * xd + focal_center[2] - T(pixel.x())) / T(u_px);
    residual[1] = (focal_center[1] * yd + focal_center[3] - T(pixel.y())) / T(u_px);
    return true;
  }
};

/// calibrate.h, eq. 2: one residual; component 0 where the code runs along x, 1 along y.
struct ProjectorResidual {
  BoardPlace place;
  const Eigen::Matrix3d* pose_rotation;
  const Eigen::Matrix3d* projector_rotation;
  int component;
  double value, u;

  template <class T>
  bool operator()(const T* focal_center, const T* distortion, const T* projector_w, const T* projector_t, const T* w,
                  const T* t, const T* scale, const T* bow, const T* print, T* residual) const {
    T board[3], cam[3], proj[3], d[2];
    place(scale, bow, print, board);
    move(*pose_rotation, w, t, board, cam);
    move(*projector_rotation, projector_w, projector_t, cam, proj);
    if (!(proj[2] > T(0.0))) return false;
    model::distort(distortion, T(proj[0] / proj[2]), T(proj[1] / proj[2]), d[0], d[1]);
    residual[0] = (focal_center[0] * d[component] + focal_center[1] - T(value)) / T(u);
    return true;
  }
};

/// (p_k - mean) / u for one component of a block.
template <int kSize>
struct PriorResidual {
  int component;
  double mean, u;

  template <class T>
  bool operator()(const T* p, T* residual) const {
    residual[0] = (p[component] - T(mean)) / T(u);
    return true;
  }
};

}  // namespace fringecal::calib::bundle
