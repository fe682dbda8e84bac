// Scanner: the file contract between calibration and measuring. Camera, projector, their relative pose, the covariance
// of all of it, what it was solved from, and how well that fitted. Schema "fringecal.scanner", version 1.
//
// Frames: `cam` (camera.h), `proj` (projector.h), and `world`, the paper's object frame, *defined* by the projector: Z
// against the projector's axis, X across the fringes with growing u, Y completing it (along the fringes), the origin O
// on the projector's axis at the working distance L from its pupil. So R, the reference plane, is Z = 0.
#pragma once

#include "calib/model/board.h"
#include "calib/model/chen2008.h"
#include "calib/model/phase_linearisation.h"
#include "calib/model/projector.h"
#include "core/provenance.h"
#include "core/rigid.h"
#include "core/uncertain.h"

#include <Eigen/Core>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::model {

/// One corner of one board pose, as measured.
struct CornerObservation {
  int column = 0, row = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double u_pixel_px = 0;          // standard uncertainty of each coordinate
  std::optional<Uncertain> x, y;  // projector coordinate in the code's unit, per coded axis
  bool used = true;               // false: rejected by the solver as an outlier
};

struct BoardObservation {
  std::string name;  // the capture it came from
  std::vector<CornerObservation> corners;
};

/// The estimated parameters, in the order of `covariance`. Names: camera.{fx_px,fy_px,cx_px,cy_px,k1,k2,p1,p2,k3},
/// projector.{x.f,x.u0,y.f,y.u0,k1,k2,p1,p2,k3}, proj_from_cam.{rotation_x_rad,...,translation_x_mm,...}. The rotation
/// is a perturbation w (rad) on the left: R = exp(w) R_estimate; all other entries are increments in the unit that the
/// name ends with.
struct ParameterCovariance {
  std::vector<std::string> names;  // "camera.fx_px", "camera.k1", "projector.x.f", "proj_from_cam.rotation_x_rad", ...
  Eigen::MatrixXd covariance;

  /// Standard uncertainty by name; empty where the parameter was not estimated.
  std::optional<double> u(const std::string& name) const;
};

/// A prior that took part in the solution, in words and numbers.
struct Prior {
  std::string parameter;
  double value = 0, u = 0;
  std::string reason;
};

struct ResidualStatistics {
  double camera_rms_px = 0;  // per coordinate
  double projector_rms = 0;  // in the code's unit
  std::string projector_unit = "mm";
  double grid_rms_mm = 0;  // all corners triangulated, against the nominal board after a rigid fit per pose
  double chi2_per_dof = 0;
  int corners_used = 0, corners_rejected = 0, poses = 0, iterations = 0;
};

struct Scanner {
  std::string name;
  Camera camera;
  Projector projector;
  Rigid3 proj_from_cam;
  double working_distance_mm = 0;  // L
  ParameterCovariance uncertainty;
  std::vector<Prior> priors;
  std::string method;  // which terms were estimated, which were chosen and why
  ResidualStatistics residuals;
  std::optional<Board> board;
  /// The board's corners as estimated with its bow and printing errors, row after row, frame board; empty: as nominal.
  std::vector<Eigen::Vector3d> board_corners_mm;
  std::vector<BoardObservation> observations;
  std::vector<Rigid3> cam_from_board;  // estimated poses, as `observations`
  /// Views of a flat witness (calib/flat_witness.h): the code's coordinate at pixels of it, and its estimated poses.
  std::vector<BoardObservation> flats;
  std::vector<Rigid3> cam_from_flat;
  double u_flatness_mm = 0;  // as it was told
  // The paper's closed form fitted to this scanner: eqs. 1 to 20, and eqs. 1 to 17 alone. Absent: not fitted.
  std::optional<FittedChen2008> paper_model, paper_ideal_model;
  std::optional<PhaseLinearisation> linearisation;  // absent: not measured
  Provenance provenance;

  /// A parameter by its name in `uncertainty`; a rotation's is that component of the rotation vector.
  double value_of(const std::string& parameter) const;
  /// This scanner with its estimated parameters changed by increments in the order of uncertainty.names (a rotation
  /// from the left). Throws InputError on a name this program does not know.
  Scanner changed_by(const Eigen::VectorXd& increments) const;

  /// Where a corner of `board` is, as far as the calibration knows.
  Eigen::Vector3d corner_mm(int column, int row) const;

  Rigid3 world_from_proj() const;
  Rigid3 world_from_cam() const { return world_from_proj() * proj_from_cam; }
  /// Distance of the pupils, mm.
  double base_mm() const { return proj_from_cam.translation_mm.norm(); }
};

void write_scanner(const std::filesystem::path& file, const Scanner& scanner);
/// Throws InputError: not a Scanner file, an unknown key, a covariance of the wrong size.
Scanner read_scanner(const std::filesystem::path& file);

Value to_value(const Rigid3& rigid);
Rigid3 rigid_from(Fields fields);
Value to_value(const ResidualStatistics& residuals);

}  // namespace fringecal::model
