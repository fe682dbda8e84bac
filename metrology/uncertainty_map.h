// What a calibration is uncertain by in the working volume, where that comes from, and what it leaves open.
//
// At a point P of the volume, with J = dd/d(parameters) (volume.h: the world's own place taken off) and C the Scanner's
// covariance,
//   U_cal = J C J^T,      U = U_cal + (dP/du)(dP/du)^T u(u)^2,   u(u) = p u(phi) / 2 pi                           (1)
// u(phi) the noise of a pixel's phase. U_cal is split into J_b C_bb J_b^T of the blocks b camera, projector, and relative
// pose. Parameters of different blocks are correlated, mostly so that their effects cancel: the parts are what each would
// do alone, and their squares add up to more than U_cal.
// What is left open: with C = L L^T, the directions v of L v that move the volume most,
//   J L v = s w,   the largest singular values s of J L / sqrt(points)                                           (2)
// one after the other; s is the rms displacement in mm that this combination of parameters is uncertain by, and each
// parameter's share is its change in its own standard uncertainties. A combination is called open where it moves the
// volume's worst point by more than 1e-4 of the working distance. A prior is called what holds a parameter where the views
// have not halved its u. mm, frame world. No result: no covariance, fewer than 20 points in the volume.
#pragma once

#include "core/value.h"
#include "metrology/volume.h"

#include <string>
#include <vector>

namespace fringecal::metrology {

struct MapOptions {
  VolumeGrid grid = {};
  double u_phase_rad =
      0.010;  // a pixel's phase from four steps at a modulation of 100 of 255 and a noise of 1.4 grey values
  int section_steps = 41;  // points along the longer side of a section; 0: no sections
};

struct PointUncertainty {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero(), u_mm = Eigen::Vector3d::Zero();  // of eq. 1, phase noise included
  double camera_mm = 0, projector_mm = 0, pose_mm = 0;                                 // root of the trace of each part
  double calibration_mm = 0, phase_mm = 0, total_mm = 0;
};

/// A combination of parameters, eq. 2.
struct OpenCombination {
  struct Share {
    std::string parameter;
    double in_u = 0;  // of its standard uncertainty
  };
  double rms_mm = 0, worst_mm = 0;  // over the volume; at the volume's worst point
  Eigen::Vector3d worst_at_mm = Eigen::Vector3d::Zero();
  std::vector<Share> shares;  // the largest first, down to 0.4
  bool open = false;
};

/// A parameter that a prior holds rather than the views.
struct HeldByPrior {
  std::string parameter;
  double u = 0, u_prior = 0, worst_mm = 0;
};

/// A plane section: values in the order of the grid, no value where camera or code do not reach.
struct Section {
  char across = 'z';  // the axis that is constant
  double at_mm = 0;
  double first_x_mm = 0, first_y_mm = 0, step_mm = 0;  // of the drawing's axes: x y, x z or y z
  int columns = 0, rows = 0;
  std::vector<std::optional<PointUncertainty>> values;
};

struct UncertaintyMap {
  std::vector<PointUncertainty> points;  // the grid
  double rms_mm = 0, worst_mm = 0;       // calibration alone
  Eigen::Vector3d worst_at_mm = Eigen::Vector3d::Zero();
  std::vector<OpenCombination> combinations;  // what makes up 99 % of the mean square, at most six
  std::vector<HeldByPrior> held;
  std::vector<Section> sections;
};

Result<UncertaintyMap> uncertainty_map(const model::Scanner& scanner, const MapOptions& options = {});

/// Sentences about what is open, one each; empty where nothing is.
std::vector<std::string> open_words(const UncertaintyMap& map);
Value to_value(const UncertaintyMap& map);

}  // namespace fringecal::metrology
