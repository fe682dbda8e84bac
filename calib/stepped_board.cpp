#include "calib/stepped_board.h"

#include "calib/model/triangulate.h"
#include "calib/reference_phase.h"
#include "core/error.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::calib {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Chen2008Model;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
// Places in the vector of unknowns; offsets and step errors follow, one per capture.
constexpr Index kQ = 9, kTurn = 9, kX0 = 10, kY0 = 11, kBoardTurn = 12, kScale = 13, kSquare = 14, kBow = 16,
                kOffsets = 19;

class SteppedSolver {
 public:
  SteppedSolver(const SteppedBoard& stepped, const Chen2008Model& start);

  /// False where the closed form has no point.
  bool place_board();
  /// A Gauss-Newton step at the unknowns: its squared length in standard deviations; no value where it is singular.
  std::optional<double> step();
  SteppedFit result(int iterations) const;
  void replace_readings(const std::vector<SteppedReading>& readings) { readings_ = readings; }
  const VectorXd& unknowns() const { return x_; }

 private:
  Index steps() const { return static_cast<Index>(stepped_.z_mm.size()); }
  Index first_common() const { return kOffsets + 2 * steps(); }
  Chen2008Model model_at(const VectorXd& x) const;
  Vector2d on_board(const SteppedReading& r) const {
    return stepped_.board.corner_mm(r.column, r.row).head<2>() - middle_;
  }
  Vector3d shape(const Vector2d& place) const {
    const Vector2d n = place.cwiseQuotient(half_);
    return {n.x() * n.x(), n.y() * n.y(), n.x() * n.y()};
  }
  Eigen::Matrix2d attitude(const VectorXd& x) const {
    return Eigen::Rotation2Dd(x[kBoardTurn]).toRotationMatrix() * Eigen::Vector2d(1, flip_).asDiagonal();
  }
  std::optional<Vector3d> seen(const VectorXd& x, const Chen2008Model& m, const SteppedReading& r) const;
  Vector3d known(const VectorXd& x, const SteppedReading& r) const;
  std::optional<Vector3d> residual(const VectorXd& x, const SteppedReading& r) const;
  std::optional<Eigen::Matrix3d> whitening(const SteppedReading& r) const;

  const SteppedBoard& stepped_;
  std::vector<SteppedReading> readings_;
  Chen2008Model start_;
  Vector2d middle_, half_;
  double flip_ = 1;         // -1: the board's rows run against Y
  VectorXd x_, scale_, u_;  // unknowns, what a derivative steps by (times 1e-4), priors' standard deviations (0: none)
  std::vector<Vector2d> print_;
  MatrixXd covariance_;
};

SteppedSolver::SteppedSolver(const SteppedBoard& stepped, const Chen2008Model& start)
    : stepped_(stepped), readings_(stepped.readings), start_(start) {
  const auto& b = stepped.board;
  middle_ = 0.5 * (b.corner_mm(b.columns - 1, b.rows - 1) + b.corner_mm(0, 0)).head<2>();
  half_ = middle_;
  print_.assign(static_cast<std::size_t>(b.corners()), Vector2d::Zero());
  Index common = 0;
  for (const auto& r : readings_) common = std::max(common, r.ref_error_rad.size());
  const Index n = first_common() + common;
  x_.setZero(n);
  u_.setZero(n);
  scale_.setOnes(n);
  double sensor2 = 1e-9;
  for (const auto& r : readings_) {
    const Vector2d d(r.pixel.x() - start.j_C_px, r.pixel.y() - start.i_C_px);
    sensor2 = std::max(sensor2, d.squaredNorm() * start.s_mm * start.s_mm);
  }
  const double field2 = half_.squaredNorm();
  x_.head<kQ>() << start.L_mm, start.b_mm, start.alpha_rad, start.p_R_mm, start.phi_O_rad, start.kc1_per_mm2,
      start.kc2_per_mm4, start.kp1_per_mm2, start.kp2_per_mm4;
  scale_.head<kQ>() << start.L_mm, std::abs(start.b_mm), 1.0, start.p_R_mm, 10.0, 1.0 / sensor2,
      1.0 / (sensor2 * sensor2), 1.0 / field2, 1.0 / (field2 * field2);
  u_[kScale] = b.u_pitch_relative;
  u_.segment<2>(kSquare).setConstant(stepped.u.square_rad);
  u_.segment<3>(kBow).setConstant(stepped.u.bow_relative * 2.0 * half_.norm());
  u_.segment(kOffsets, steps()).setConstant(stepped.u.phase_offset_rad);
  u_.segment(kOffsets + steps(), steps()).setConstant(stepped.u.step_mm);
  u_.tail(common).setOnes();
}

Chen2008Model SteppedSolver::model_at(const VectorXd& x) const {
  Chen2008Model m = start_;
  m.L_mm = x[0];
  m.b_mm = x[1];
  m.alpha_rad = x[2];
  m.p_R_mm = x[3];
  m.phi_O_rad = x[4];
  m.kc1_per_mm2 = x[5];
  m.kc2_per_mm4 = x[6];
  m.kp1_per_mm2 = x[7];
  m.kp2_per_mm4 = x[8];
  return m;
}

/// The closed form's point of eq. 1.
std::optional<Vector3d> SteppedSolver::seen(const VectorXd& x, const Chen2008Model& m, const SteppedReading& r) const {
  const Vector2d centre = m.axis == CodeAxis::x ? Vector2d(m.j_C_px, m.i_C_px) : Vector2d(-m.i_C_px, m.j_C_px);
  const Vector2d pixel = centre + Eigen::Rotation2Dd(x[kTurn]) * (r.pixel - centre);
  double reference = 0;
  for (Index k = 0; k < steps(); ++k) {
    if (stepped_.z_mm[static_cast<std::size_t>(k)] == 0) reference = x[kOffsets + k];
  }
  double phi_ref = r.phi_ref - reference - r.ref_error_rad.dot(x.segment(first_common(), r.ref_error_rad.size()));
  const auto on_R = m.point_mm(pixel, phi_ref, phi_ref, true);
  if (!on_R) return std::nullopt;
  const Vector2d place = attitude(x).transpose() * (on_R->head<2>() - x.segment<2>(kX0));
  const double h = x.segment<3>(kBow).dot(shape(place));
  phi_ref -= kTwoPi * m.b_mm * h / (m.p_R_mm * (m.L_mm - h));  // phi_h
  return m.point_mm(pixel, r.phi_obj - x[kOffsets + r.step], phi_ref, true);
}

Vector3d SteppedSolver::known(const VectorXd& x, const SteppedReading& r) const {
  const Vector2d place = on_board(r);
  const double z = stepped_.z_mm[static_cast<std::size_t>(r.step)] +
                   (stepped_.z_mm[static_cast<std::size_t>(r.step)] == 0 ? 0.0 : x[kOffsets + steps() + r.step]);
  Vector3d out;
  const Vector2d printed = place + print_[static_cast<std::size_t>(r.row * stepped_.board.columns + r.column)];
  out.head<2>() = (1.0 + x[kScale]) * (attitude(x) * printed) + x.segment<2>(kX0) + z * x.segment<2>(kSquare);
  out.z() = z + x.segment<3>(kBow).dot(shape(place));
  return out;
}

std::optional<Vector3d> SteppedSolver::residual(const VectorXd& x, const SteppedReading& r) const {
  const auto point = seen(x, model_at(x), r);
  if (!point || !point->allFinite()) return std::nullopt;
  return Vector3d(*point - known(x, r));  // eq. 1
}

/// W with W^T W the inverse of the covariance of a reading's residual.
std::optional<Eigen::Matrix3d> SteppedSolver::whitening(const SteppedReading& r) const {
  const Chen2008Model m = model_at(x_);
  const auto here = seen(x_, m, r);
  if (!here) return std::nullopt;
  const double per_px = m.L_mm * m.s_mm / m.f_C_mm;
  Eigen::Matrix3d v = Eigen::Matrix3d::Zero();
  v(0, 0) = v(1, 1) = std::pow(stepped_.u.pixel_px * per_px, 2);
  v(2, 2) = 1e-12;  // rounding: keeps v regular where the phases are perfect
  for (double SteppedReading::*phase : {&SteppedReading::phi_obj, &SteppedReading::phi_ref}) {
    if (phase == &SteppedReading::phi_ref && r.ref_error_rad.size() > 0) continue;
    SteppedReading moved = r;
    moved.*phase += 1e-3;
    const auto there = seen(x_, m, moved);
    if (!there) return std::nullopt;
    const Vector3d by = (*there - *here) / 1e-3 * stepped_.u.phase_rad;
    v += by * by.transpose();
  }
  return Eigen::Matrix3d(Eigen::LLT<Eigen::Matrix3d>(v).matrixL().solve(Eigen::Matrix3d::Identity()));
}

bool SteppedSolver::place_board() {
  // The board's place by the closed form at the start: a rigid motion in the plane, one of the two ways round.
  double best = HUGE_VAL;
  for (const double flip : {1.0, -1.0}) {
    Vector2d a = Vector2d::Zero(), b = Vector2d::Zero();
    std::vector<std::pair<Vector2d, Vector2d>> pairs;
    for (const auto& r : readings_) {
      const auto point = seen(x_, model_at(x_), r);
      if (!point) return false;
      pairs.emplace_back(Eigen::Vector2d(1, flip).asDiagonal() * on_board(r), point->head<2>());
      a += pairs.back().first / static_cast<double>(readings_.size());
      b += pairs.back().second / static_cast<double>(readings_.size());
    }
    double dot = 0, cross = 0;
    for (const auto& [from, to] : pairs) {
      dot += (from - a).dot(to - b);
      cross += (from - a).x() * (to - b).y() - (from - a).y() * (to - b).x();
    }
    const double turn = std::atan2(cross, dot), fit = -std::hypot(dot, cross);
    if (!(fit < best)) continue;
    best = fit;
    flip_ = flip;
    x_[kBoardTurn] = turn;
    x_.segment<2>(kX0) = b - Eigen::Rotation2Dd(turn) * a;
  }
  return true;
}

std::optional<double> SteppedSolver::step() {
  const Index n = x_.size();
  MatrixXd normal = MatrixXd::Zero(n, n);
  VectorXd gradient = VectorXd::Zero(n);
  const std::size_t corners = print_.size();
  std::vector<Eigen::Matrix2d> own(corners, Eigen::Matrix2d::Zero());
  std::vector<MatrixXd> cross(corners, MatrixXd::Zero(2, n));
  std::vector<Vector2d> own_gradient(corners, Vector2d::Zero());
  const double u_print = stepped_.board.u_print_mm;
  Eigen::Matrix<double, 3, 2> by_print = Eigen::Matrix<double, 3, 2>::Zero();
  by_print.topRows<2>() = -(1.0 + x_[kScale]) * attitude(x_);
  MatrixXd j(3, n);
  for (const auto& r : readings_) {
    const auto w = whitening(r);
    const auto here = residual(x_, r);
    if (!w || !here) return std::nullopt;
    j.setZero();
    if (r.ref_error_rad.size() > 0) {
      SteppedReading moved = r;
      moved.phi_ref += 1e-3;
      const auto there = residual(x_, moved);
      if (!there) return std::nullopt;
      j.middleCols(first_common(), r.ref_error_rad.size()) = (*here - *there) / 1e-3 * r.ref_error_rad.transpose();
    }
    for (Index k = 0; k < first_common(); ++k) {
      const bool of_a_step = k >= kOffsets;
      const Index step = of_a_step ? (k - kOffsets) % steps() : 0;
      const bool reference = of_a_step && stepped_.z_mm[static_cast<std::size_t>(step)] == 0;
      if (of_a_step && step != r.step && !(reference && k < kOffsets + steps())) continue;
      if (u_[k] == 0 && k == kScale) continue;
      VectorXd up = x_, down = x_;
      const double d = 1e-4 * scale_[k];
      up[k] += d;
      down[k] -= d;
      const auto a = residual(up, r), b = residual(down, r);
      if (!a || !b) return std::nullopt;
      j.col(k) = (*a - *b) / (2.0 * d);
    }
    j = *w * j;
    const Vector3d white = *w * *here;
    normal += j.transpose() * j;
    gradient += j.transpose() * white;
    if (!(u_print > 0)) continue;
    const auto at = static_cast<std::size_t>(r.row * stepped_.board.columns + r.column);
    const Eigen::Matrix<double, 3, 2> e = *w * by_print;
    own[at] += e.transpose() * e;
    cross[at] += e.transpose() * j;
    own_gradient[at] += e.transpose() * white;
  }
  for (Index k = 0; k < n; ++k) {
    // A zero uncertainty holds the unknown; so does the reference's own step, which is where Z = 0.
    const bool held =
        (k >= kScale && !(u_[k] > 0)) || (k >= kOffsets + steps() && k < first_common() &&
                                          stepped_.z_mm[static_cast<std::size_t>(k - kOffsets - steps())] == 0);
    const double u = held ? 1e-9 * scale_[k] : u_[k];
    if (!(u > 0)) continue;
    normal(k, k) += 1.0 / (u * u);
    gradient[k] += x_[k] / (u * u);
  }
  std::vector<Eigen::Matrix2d> inverse(corners, Eigen::Matrix2d::Zero());
  if (u_print > 0) {
    for (std::size_t c = 0; c < corners; ++c) {
      inverse[c] = (own[c] + Eigen::Matrix2d::Identity() / (u_print * u_print)).inverse();
      own_gradient[c] += print_[c] / (u_print * u_print);
      normal -= cross[c].transpose() * inverse[c] * cross[c];
      gradient -= cross[c].transpose() * (inverse[c] * own_gradient[c]);
    }
  }
  const VectorXd unit = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LLT<MatrixXd> llt(unit.asDiagonal() * normal * unit.asDiagonal());
  if (llt.info() != Eigen::Success || !(llt.matrixLLT().diagonal().cwiseAbs2().minCoeff() > 1e-14)) return std::nullopt;
  covariance_ = unit.asDiagonal() * MatrixXd(llt.solve(MatrixXd::Identity(n, n))) * unit.asDiagonal();
  const VectorXd d = -covariance_ * gradient;
  if (u_print > 0) {
    for (std::size_t c = 0; c < corners; ++c) print_[c] -= inverse[c] * (own_gradient[c] + cross[c] * d);
  }
  x_ += d;
  if (!x_.allFinite()) return std::nullopt;
  return -d.dot(gradient);
}

SteppedFit SteppedSolver::result(int iterations) const {
  SteppedFit out;
  out.model = model_at(x_);
  out.values = x_.head<kQ>();
  out.covariance = covariance_.topLeftCorner<kQ, kQ>();
  out.iterations = iterations;
  VectorXd nominal = x_;
  nominal.segment<2>(kSquare).setZero();
  nominal.segment(kOffsets + steps(), steps()).setZero();
  for (const auto& r : readings_) {
    if (const auto d = residual(x_, r)) out.rms_xyz_mm += d->cwiseAbs2() / static_cast<double>(readings_.size());
    out.places_mm.push_back(known(nominal, r));
    const double z = stepped_.z_mm[static_cast<std::size_t>(r.step)];
    out.nominal_places_mm.emplace_back(0, 0, z);
    out.nominal_places_mm.back().head<2>() = attitude(x_) * on_board(r) + x_.segment<2>(kX0);
  }
  out.rms_xyz_mm = out.rms_xyz_mm.cwiseSqrt();
  return out;
}

Result<SteppedFit> solved(SteppedSolver& solver) {
  constexpr int kIterations = 40;
  if (!solver.place_board())
    return unanswerable("the paper's closed form has no point for a corner of the stepped board");
  for (int i = 1; i <= kIterations; ++i) {
    const auto length2 = solver.step();
    if (!length2) break;
    if (*length2 < 1e-10) return solver.result(i);
  }
  return unanswerable(
      "the paper's parameters cannot be estimated from the stepped board: the fit does not converge; give at least "
      "three "
      "steps over a tenth of the working distance, nearest first, Z growing towards the scanner");
}

/// The readings that a full model says the captures hold: the board flat, where `places` says it is, without noise.
std::optional<std::vector<SteppedReading>> readings_of(const model::Scanner& s, const Rigid3& cam_from_world,
                                                       const std::vector<SteppedReading>& readings,
                                                       const std::vector<Vector3d>& places) {
  const CodeAxis axis = s.projector.main_axis();
  const FringeCode& code = s.projector.axis(axis)->code;
  const Vector3d eye = cam_from_world.inverse().translation_mm;
  std::vector<SteppedReading> out = readings;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Vector3d p = cam_from_world * places[i];
    // Where the camera's ray through it meets Z = 0.
    const Vector3d on_R = eye + eye.z() / (eye.z() - places[i].z()) * (places[i] - eye);
    const auto pixel = s.camera.project(p);
    const auto obj = s.projector.project(axis, s.proj_from_cam * p);
    const auto ref = s.projector.project(axis, s.proj_from_cam * (cam_from_world * on_R));
    if (!pixel || !obj || !ref) return std::nullopt;
    out[i].pixel = *pixel;
    out[i].phi_obj = code.phase_from_u(*obj);
    out[i].phi_ref = code.phase_from_u(*ref);
  }
  return out;
}

/// cam_from_world of the stepped board as a full model triangulates its corners; empty where it cannot.
std::optional<Rigid3> placed_by(const model::Scanner& s, const std::vector<SteppedReading>& readings,
                                const std::vector<Vector3d>& places) {
  const CodeAxis axis = s.projector.main_axis();
  const auto n = static_cast<Index>(readings.size());
  Eigen::Matrix3Xd world(3, n), cam(3, n);
  for (Index i = 0; i < n; ++i) {
    const auto& r = readings[static_cast<std::size_t>(i)];
    const auto p = model::triangulate(s.camera, s.projector, s.proj_from_cam, axis, r.pixel,
                                      s.projector.axis(axis)->code.u_from_phase(r.phi_obj));
    if (!p) return std::nullopt;
    world.col(i) = places[static_cast<std::size_t>(i)];
    cam.col(i) = *p;
  }
  const Eigen::Matrix4d t = Eigen::umeyama(world, cam, false);
  return Rigid3{Eigen::Quaterniond(Eigen::Matrix3d(t.topLeftCorner<3, 3>())), t.topRightCorner<3, 1>()};
}

}  // namespace

Result<SteppedFit> fit_stepped_board(const SteppedBoard& stepped, const Chen2008Model& start) {
  if (stepped.z_mm.size() < 3 || stepped.readings.size() < 40) {
    return unanswerable(
        fmt::format("{} steps of the board with {} readings; at least 3 steps and 40 readings are needed",
                    stepped.z_mm.size(), stepped.readings.size()));
  }
  require(std::count(stepped.z_mm.begin(), stepped.z_mm.end(), 0.0) == 1,
          "one step of a stepped board is the reference");
  SteppedSolver solver(stepped, start);
  return solved(solver);
}

Result<SteppedComparison> compare_stepped_board(const SteppedBoard& stepped, const model::Scanner& scanner) {
  const Chen2008Model start = model::chen2008_from(scanner);
  auto direct = fit_stepped_board(stepped, start);
  if (!direct) return tl::unexpected(direct.error());
  std::vector<Vector3d> places = direct->places_mm;
  const auto readings_by = [&](const model::Scanner& s) -> std::optional<std::vector<SteppedReading>> {
    const auto cam_from_world = placed_by(s, stepped.readings, places);
    return cam_from_world ? readings_of(s, *cam_from_world, stepped.readings, direct->nominal_places_mm) : std::nullopt;
  };
  const Unanswerable out_of_reach{
      "the stepped board is not wholly in the full model's reach; leave out the outer steps"};
  SteppedBoard computed = stepped;
  std::optional<SteppedSolver> solver;
  std::optional<SteppedFit> from_full;
  // A flat board in a geometry that is not the paper's looks bowed to the closed form. That bow is in the fitted places, and
  // the board is not where they are: what the fit makes of the full model's flat board is taken off, until it stays.
  for (int pass = 0; pass < 3; ++pass) {
    auto clean = readings_by(scanner);
    if (!clean) return tl::unexpected(out_of_reach);
    computed.readings = std::move(*clean);
    solver.emplace(computed, start);
    auto found = solved(*solver);
    if (!found) return tl::unexpected(found.error());
    from_full = std::move(*found);
    for (std::size_t i = 0; i < places.size(); ++i) {
      places[i] = direct->places_mm[i] - (from_full->places_mm[i] - from_full->nominal_places_mm[i]);
    }
  }
  // dq/d(parameter): what one Gauss-Newton step makes of the changed readings.
  const auto& u = scanner.uncertainty;
  MatrixXd by(kQ, static_cast<Index>(u.names.size()));
  for (Index k = 0; k < by.cols(); ++k) {
    const double d = std::sqrt(std::max(u.covariance(k, k), 0.0));
    by.col(k).setZero();
    if (!(d > 0)) continue;
    const auto moved = readings_by(scanner.changed_by(d * VectorXd::Unit(by.cols(), k)));
    if (!moved) return tl::unexpected(out_of_reach);
    SteppedSolver other = *solver;
    other.replace_readings(*moved);
    if (!other.step()) return tl::unexpected(out_of_reach);
    by.col(k) = (other.unknowns().head<kQ>() - solver->unknowns().head<kQ>()) / d;
  }
  SteppedComparison out{std::move(*direct), std::move(*from_full), {}, {}};
  out.computed.covariance = by * u.covariance * by.transpose();
  out.difference = out.direct.values - out.computed.values;
  out.u_difference = (out.direct.covariance + out.computed.covariance).diagonal().cwiseSqrt();
  return out;
}

SteppedUncertainty uncertainty_from(const model::Scanner& s) {
  SteppedUncertainty out;
  const FringeCode& code = s.projector.axis(s.projector.main_axis())->code;
  const double rad = kTwoPi / code.period;
  double squares = 0, count = 0;
  for (const auto& o : s.observations) {
    for (const auto& c : o.corners) {
      const auto& u = s.projector.main_axis() == CodeAxis::x ? c.x : c.y;
      out.pixel_px = c.u_pixel_px;
      if (!u) continue;
      squares += u->u * u->u;
      count += 1;
    }
  }
  if (count > 0) out.phase_rad = rad * std::sqrt(squares / count);
  for (const auto& p : s.priors) {
    if (p.parameter == "capture.phase_offset") out.phase_offset_rad = rad * p.u;
  }
  return out;
}

Result<SteppedBoard> observe_stepped_board(std::span<const std::filesystem::path> folders, std::span<const double> z_mm,
                                           const model::Board& board, const model::PhaseLinearisation* table) {
  if (folders.size() != z_mm.size()) {
    throw InputError(fmt::format("{} captures of the stepped board, {} heights; give one height for each",
                                 folders.size(), z_mm.size()));
  }
  if (std::count(z_mm.begin(), z_mm.end(), 0.0) != 1) {
    throw InputError("one height of the stepped board must be 0: that capture is the reference");
  }
  const auto at = static_cast<std::size_t>(std::find(z_mm.begin(), z_mm.end(), 0.0) - z_mm.begin());
  const Capture reference = read_capture(folders[at]);
  const CodeAxis axis = reference.info.plan.x ? CodeAxis::x : CodeAxis::y;
  const auto* own = table && table->axis == axis ? table : nullptr;
  const decode::PhaseMap map = decode::decode_for_measuring(reference, axis, own).map;
  const auto views = observe_captures(folders, board, table);
  if (!views.dropped.empty()) return unanswerable(views.dropped.front().name + ": " + views.dropped.front().reason);
  SteppedBoard out{{z_mm.begin(), z_mm.end()}, {}, board, {}};
  const FringeCode& code = *reference.info.plan.code(axis);
  const auto phase = ReferencePhase::fit(map);
  if (!phase) return tl::unexpected(phase.error());
  for (std::size_t k = 0; k < views.observations.size(); ++k) {
    for (const auto& c : views.observations[k].corners) {
      const auto& obj = axis == CodeAxis::x ? c.x : c.y;
      if (!obj || !phase->covers(c.pixel)) continue;
      out.readings.push_back({static_cast<int>(k), c.column, c.row, c.pixel, code.phase_from_u(obj->value),
                              phase->at_rad(c.pixel), phase->error_rad(c.pixel)});
    }
  }
  return out;
}

}  // namespace fringecal::calib
