#include "calib/calibrate.h"

#include "calib/flat_witness.h"
#include "calib/initialise.h"
#include "calib/joint_solve.h"
#include "calib/model/triangulate.h"
#include "calib/tsai.h"
#include "core/error.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

#include <cmath>

namespace fringecal::calib {
namespace {

using model::BoardObservation;
using model::Scanner;

constexpr std::array kRicher = {DistortionTerms::radial, DistortionTerms::radial_tangential, DistortionTerms::full};

/// Fewer corners than this say less about a pose than its six parameters and the camera need together.
constexpr std::size_t kMinCorners = 8;

std::string defect_of(const BoardObservation& o, const model::Board& board) {
  if (o.corners.size() < kMinCorners) {
    return fmt::format("{}: {} corners; a pose needs at least {}", o.name, o.corners.size(), kMinCorners);
  }
  for (const auto& c : o.corners) {
    if (c.column < 0 || c.column >= board.columns || c.row < 0 || c.row >= board.rows) {
      return fmt::format("{}: corner ({}, {}) is not on a board of {} x {}", o.name, c.column, c.row, board.columns,
                         board.rows);
    }
    bool finite = c.pixel.allFinite() && c.u_pixel_px > 0 && std::isfinite(c.u_pixel_px);
    for (const auto& u : {c.x, c.y})
      finite = finite && (!u || (std::isfinite(u->value) && u->u > 0 && std::isfinite(u->u)));
    if (!finite) {
      return fmt::format("{}: corner ({}, {}) has a value or uncertainty that is not finite or not positive", o.name,
                         c.column, c.row);
    }
  }
  return "";
}

Bundle bundle_of(std::span<const BoardObservation> observations, const model::Board& board) {
  Bundle b;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column)
      b.targets_mm.push_back(board.corner_mm(column, row).head<2>());
  }
  b.cam_from_board.resize(observations.size());
  // One uncertainty for all corners: the scatter within a pose is known from a few dozen corners only, and where it is
  // larger in one pose the board was bent there, which is not noise to be weighted by.
  double squares = 0;
  std::size_t count = 0;
  for (const auto& o : observations) {
    for (const auto& c : o.corners) squares += c.u_pixel_px * c.u_pixel_px;
    count += o.corners.size();
  }
  const double u_pixel = std::sqrt(squares / static_cast<double>(count));
  for (std::size_t pose = 0; pose < observations.size(); ++pose) {
    for (const auto& c : observations[pose].corners) {
      b.sights.push_back({static_cast<int>(pose), c.row * board.columns + c.column, c.pixel, u_pixel, c.x, c.y, true});
    }
  }
  return b;
}

/// The set with the lowest Bayesian information criterion, BIC = chi2 + p ln n with the scales of the richest set for
/// all. `terms` picks the field of the settings that varies. The bundle ends at the solution of the chosen set.
struct Choice {
  DistortionTerms terms = DistortionTerms::radial;
  std::string words;  // the figures, for Scanner.method
};

Result<Choice> choose_terms(Bundle& bundle, SolveSettings settings, DistortionTerms FreeTerms::*terms) {
  settings.free.*terms = DistortionTerms::full;
  Bundle richest = bundle;
  auto reference = solve_bundle(richest, settings);
  if (!reference) {
    settings.free.*terms = DistortionTerms::radial;
    richest = bundle;
    reference = solve_bundle(richest, settings);
    if (!reference) return tl::unexpected(reference.error());
    bundle = std::move(richest);
    return Choice{DistortionTerms::radial, "richer sets are not determined by the poses"};
  }
  settings.components = reference->components;
  settings.fixed_components = true;
  Choice best;
  double best_bic = 0;
  std::optional<Bundle> solved;
  std::optional<Unanswerable> simplest;
  for (const DistortionTerms candidate : kRicher) {
    settings.free.*terms = candidate;
    Bundle trial = bundle;
    for (std::size_t k = 0; k < trial.sights.size(); ++k) trial.sights[k].used = richest.sights[k].used;
    const auto report = solve_bundle(trial, settings);
    if (!report) {
      if (!simplest) simplest = report.error();
      continue;
    }
    const double bic = report->chi2 + term_count(candidate) * std::log(static_cast<double>(report->residuals));
    best.words += fmt::format("{}BIC {} {:.1f}", best.words.empty() ? "" : ", ", name_of(candidate), bic);
    if (!solved || bic < best_bic) {
      best.terms = candidate;
      best_bic = bic;
      solved = std::move(trial);
    }
  }
  if (!solved) return tl::unexpected(*simplest);
  bundle = std::move(*solved);
  return best;
}

/// Triangulated corners, rejected ones too, against the nominal grid, each pose after a rigid fit: root mean square of the
/// distances.
double grid_rms_mm(const Bundle& bundle) {
  const auto& projector = *bundle.projector;
  const CodeAxis axis = projector.main_axis();
  double sum = 0;
  int count = 0;
  for (std::size_t pose = 0; pose < bundle.cam_from_board.size(); ++pose) {
    std::vector<Eigen::Vector3d> measured, nominal;
    for (const Sight& s : bundle.sights) {
      const auto& u = axis == CodeAxis::x ? s.x : s.y;
      if (static_cast<std::size_t>(s.pose) != pose || s.target == kOnFlat || !u) continue;
      const auto point = model::triangulate(bundle.camera, projector, bundle.proj_from_cam, axis, s.pixel, u->value);
      if (!point) continue;
      const Eigen::Vector2d& t = bundle.targets_mm[static_cast<std::size_t>(s.target)];
      measured.push_back(*point);
      nominal.emplace_back(t.x(), t.y(), 0.0);
    }
    if (measured.size() < 4) continue;
    const auto n = static_cast<Eigen::Index>(measured.size());
    const Eigen::Map<const Eigen::Matrix3Xd> m(measured.front().data(), 3, n), b(nominal.front().data(), 3, n);
    const Eigen::Matrix4d cam_from_board = Eigen::umeyama(b, m, false);
    const Eigen::Matrix3Xd off = m - ((cam_from_board.topLeftCorner<3, 3>() * b).colwise() +
                                      Eigen::Vector3d(cam_from_board.topRightCorner<3, 1>()));
    sum += off.squaredNorm();
    count += static_cast<int>(n);
  }
  return count > 0 ? std::sqrt(sum / count) : 0.0;
}

/// L by default: the corners' mean distance along the projector's axis.
double mean_distance_mm(const Bundle& bundle) {
  double sum = 0;
  int count = 0;
  for (const Sight& s : bundle.sights) {
    if (s.target == kOnFlat) continue;
    ++count;
    const Eigen::Vector2d& t = bundle.targets_mm[static_cast<std::size_t>(s.target)];
    const auto& pose = bundle.cam_from_board[static_cast<std::size_t>(s.pose)];
    sum += (bundle.proj_from_cam * (pose * Eigen::Vector3d(t.x(), t.y(), 0))).z();
  }
  return sum / count;
}

/// Root mean square of the stated uncertainties of the projector coordinates.
double mean_u_coordinate(const Bundle& bundle, CodeAxis axis) {
  double sum = 0;
  int count = 0;
  for (const Sight& s : bundle.sights) {
    const auto& u = axis == CodeAxis::x ? s.x : s.y;
    if (!u) continue;
    sum += u->u * u->u;
    ++count;
  }
  return count > 0 ? std::sqrt(sum / count) : 0.0;
}

/// The sentence about a focal length that the poses leave open by more than a tenth, or nothing.
std::string open_focal_length(const model::ParameterCovariance& covariance, const std::string& name, double f) {
  const double u = covariance.u(name).value_or(0.0);
  if (u <= 0.1 * std::abs(f)) return "";
  return fmt::format(
      "the poses leave {} open: {:.4g} with a standard uncertainty of {:.2g}; capture the board tilted by 20 "
      "to 40 degrees about different axes",
      name, f, u);
}

/// What priors and variance components held at the solution.
std::vector<model::Prior> priors_of(const Components& c, CodeAxis main) {
  std::vector<model::Prior> out;
  if (c.pitch > 0) {
    out.push_back({"board.pitch_relative_error", 0.0, c.pitch, "the board's certificate or its maker"});
  }
  if (c.print_mm > 0) {
    out.push_back({"board.print_error_mm", 0.0, c.print_mm,
                   "of each corner, x and y, the same in every pose; estimated from the views"});
  }
  if (c.bow_mm > 0) {
    out.push_back({"board.bow_mm", 0.0, c.bow_mm, "two parabolas and a twist over the board's field"});
  }
  if (c.flat_bow_mm > 0) {
    out.push_back({"flat.bow_mm", 0.0, c.flat_bow_mm, "two parabolas and a twist over the seen part of the flat"});
  }
  if (c.relief_mm > 0) {
    out.push_back({"board.relief_mm", 0.0, c.relief_mm,
                   "of each corner's height over the smooth board, the same in every pose; estimated from the views"});
  }
  if (c.bend_mm > 0) {
    out.push_back({"board.bend_mm", 0.0, c.bend_mm,
                   "two parabolas and a twist, new in every pose: how the board is held; estimated from the views"});
  }
  if (c.phase_offset > 0) {
    out.push_back(
        {"capture.phase_offset", 0.0, c.phase_offset,
         "of u, one value for all corners of a capture: the mean error of its phase steps; estimated from the "
         "views"});
  }
  if (c.along_mm > 0) {
    out.push_back(
        {main == CodeAxis::x ? "proj_from_cam.translation_y_mm" : "proj_from_cam.translation_x_mm", 0.0, c.along_mm,
         "the code of one axis does not see the projector's place along the fringes; the pupils are taken as level "
         "along them within a tenth of the base line"});
  }
  return out;
}

/// Two covariances of different parameters, taken as independent.
model::ParameterCovariance side_by_side(const model::ParameterCovariance& a, const model::ParameterCovariance& b) {
  model::ParameterCovariance out = a;
  out.names.insert(out.names.end(), b.names.begin(), b.names.end());
  const Eigen::Index na = a.covariance.rows(), nb = b.covariance.rows();
  out.covariance.setZero(na + nb, na + nb);
  out.covariance.topLeftCorner(na, na) = a.covariance;
  out.covariance.bottomRightCorner(nb, nb) = b.covariance;
  return out;
}

/// Camera and poses of the bundle by Tsai's method, all corners.
Result<TsaiSolution> start_by_tsai(Bundle& bundle) {
  std::vector<PlanarView> views(bundle.cam_from_board.size());
  for (const Sight& s : bundle.sights) {
    auto& view = views[static_cast<std::size_t>(s.pose)];
    view.board_mm.push_back(bundle.targets_mm[static_cast<std::size_t>(s.target)]);
    view.pixels.push_back(s.pixel);
  }
  auto found = calibrate_tsai(views, bundle.camera.width_px, bundle.camera.height_px);
  if (!found) return found;
  bundle.camera = found->camera;
  bundle.cam_from_board = found->cam_from_board;
  return found;
}

/// The camera's part of a report from Tsai's method: fx and fy are one number.
SolveReport report_of(const TsaiSolution& found, const Bundle& bundle) {
  SolveReport out;
  out.covariance.names = {"camera.fx_px", "camera.fy_px", "camera.k1", "camera.k2"};
  Eigen::MatrixXd by = Eigen::MatrixXd::Zero(4, 3);
  by(0, 0) = by(1, 0) = by(2, 1) = by(3, 2) = 1.0;
  out.covariance.covariance = by * found.covariance * by.transpose();
  out.camera_rms_px = found.rms_px;
  out.components.camera = found.rms_px / bundle.sights.front().u_pixel_px;
  return out;
}

void fill_observations(Scanner& scanner, std::span<const BoardObservation> observations, const Bundle& bundle,
                       const SolveReport& report) {
  scanner.observations.assign(observations.begin(), observations.end());
  std::size_t k = 0;
  for (auto* observed : {&scanner.observations, &scanner.flats}) {
    const bool flat = observed == &scanner.flats;
    const double factor = flat ? report.components.flat : report.components.projector;
    for (auto& o : *observed) {
      for (auto& c : o.corners) {
        const Sight& sight = bundle.sights[k++];
        c.used = sight.used;
        if (!flat) c.u_pixel_px = sight.u_pixel_px * report.components.camera;
        if (c.x) c.x->u *= factor;
        if (c.y) c.y->u *= factor;
      }
    }
  }
}

/// The pose most of whose corners were left out, in words; nothing where none was.
std::string worst_pose(const Bundle& bundle, std::span<const BoardObservation> observations) {
  std::vector<int> left_out(observations.size(), 0);
  for (const Sight& s : bundle.sights) {
    if (s.target != kOnFlat && !s.used) ++left_out[static_cast<std::size_t>(s.pose)];
  }
  const auto worst = std::max_element(left_out.begin(), left_out.end());
  if (*worst == 0) return "";
  const auto& o = observations[static_cast<std::size_t>(worst - left_out.begin())];
  return fmt::format("; look at {} first: {} of its {} corners do not fit", o.name, *worst, o.corners.size());
}

/// bundle.h, eq. 1, at the solution.
std::vector<Eigen::Vector3d> estimated_corners(const model::Board& board, const Bundle& bundle) {
  std::vector<Eigen::Vector3d> out;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      out.push_back(bundle.corner_mm(static_cast<std::size_t>(row * board.columns + column)));
    }
  }
  return out;
}

}  // namespace

Result<Scanner> calibrate(std::span<const BoardObservation> observations, const model::Board& board, int width_px,
                          int height_px, const PatternPlan& plan, const CalibrationOptions& options) {
  require(width_px > 0 && height_px > 0, "calibrate() gets the size of the camera's images");
  require(plan.x || plan.y, "calibrate() gets a plan that codes at least one axis");
  const bool both = plan.x && plan.y;
  const int needed = std::max(options.min_poses, 3);
  if (static_cast<int>(observations.size()) < needed) {
    return unanswerable(
        fmt::format("{} poses of the board; at least {} are needed, 10 to 15 with different tilts are good",
                    observations.size(), needed));
  }
  if (!both && options.projector_terms != DistortionTerms::none && options.projector_terms != DistortionTerms::radial) {
    return unanswerable(
        "a projector coded along one axis shows radial distortion only: projector terms 'none' or 'radial'");
  }
  for (const auto& o : observations) {
    if (const std::string defect = defect_of(o, board); !defect.empty()) return unanswerable(defect);
  }

  Bundle bundle = bundle_of(observations, board);
  bundle.camera.width_px = width_px;
  bundle.camera.height_px = height_px;
  const bool tsai = options.method == CalibrationMethod::tsai,
             staged = tsai || options.method == CalibrationMethod::staged;
  std::optional<TsaiSolution> by_tsai;
  if (tsai || options.start == CameraStart::tsai) {
    auto started = start_by_tsai(bundle);
    if (!started) return tl::unexpected(started.error());
    by_tsai = std::move(*started);
  } else if (const auto started = initialise_camera(bundle); !started) {
    return tl::unexpected(started.error());
  }

  SolveSettings settings;
  if (staged) {
    settings.outliers = Outliers::keep;
  } else {
    settings.components.print_mm = board.u_print_mm;
    settings.components.pitch = board.u_pitch_relative;
  }
  std::string method = tsai ? "camera by Tsai's two stages with the principal point in the image's middle, then the "
                              "projector with the camera held"
                       : staged ? "camera alone by plain least squares, then the projector with the camera held"
                                : "camera and projector jointly, robust least squares with variance components";
  settings.free.camera = tsai ? DistortionTerms::radial : options.camera_terms;
  std::string words;
  if (settings.free.camera == DistortionTerms::automatic) {
    auto choice = choose_terms(bundle, settings, &FreeTerms::camera);
    if (!choice) return tl::unexpected(choice.error());
    settings.free.camera = choice->terms;
    words = fmt::format(" ({})", choice->words);
  }
  settings.pose_check = staged ? PoseCheck::yes : PoseCheck::no;
  const auto alone = tsai ? Result<SolveReport>(report_of(*by_tsai, bundle)) : solve_bundle(bundle, settings);
  if (!alone) return tl::unexpected(alone.error());
  method += fmt::format("; camera terms {}{}", name_of(settings.free.camera), words);

  bundle.projector.emplace();
  if (plan.x) bundle.projector->x = model::ProjectorAxis{*plan.x, 0, 0};
  if (plan.y) bundle.projector->y = model::ProjectorAxis{*plan.y, 0, 0};
  const CodeAxis main = bundle.projector->main_axis();
  if (const auto started = initialise_projector(bundle); !started) return tl::unexpected(started.error());
  const double diagonal = (bundle.targets_mm.back() - bundle.targets_mm.front()).norm();
  if (staged) {
    settings.free.camera_and_poses = false;
    settings.outliers = Outliers::reject;
  } else {
    settings.components.bow_mm = options.u_bow_relative * diagonal;
    // Starts of the components that are estimated, generous: a start that is too small holds a capture's offset back, and
    // its corners look like outliers. A tenth of the bow's prior; ten times what a corner's u is uncertain by.
    settings.components.bend_mm = 0.1 * settings.components.bow_mm;
    if (board.u_print_mm > 0) settings.components.relief_mm = 0.1 * settings.components.bow_mm;
    settings.components.phase_offset = 10.0 * mean_u_coordinate(bundle, main);
  }
  if (!both) settings.components.along_mm = 0.1 * bundle.proj_from_cam.translation_mm.norm();
  method += "; projector terms ";
  if (options.projector_terms == DistortionTerms::automatic) {
    auto choice = choose_terms(bundle, settings, &FreeTerms::projector);
    if (!choice) return tl::unexpected(choice.error());
    settings.free.projector = choice->terms;
    method += fmt::format("{} ({})", name_of(choice->terms), choice->words);
  } else {
    settings.free.projector = options.projector_terms;
    method += name_of(settings.free.projector);
  }
  if (!staged && !options.flats.empty()) {
    if (const auto added = add_flats(bundle, options.flats); !added) return tl::unexpected(added.error());
    settings.components.flat_bow_mm = options.u_flatness_mm;
  }
  settings.pose_check = PoseCheck::yes;
  auto report = solve_bundle(bundle, settings);
  if (!report) return tl::unexpected(report.error());
  if (staged) {
    report->covariance = side_by_side(alone->covariance, report->covariance);
    report->camera_rms_px = alone->camera_rms_px;
    report->components.camera = alone->components.camera;
  }
  for (const auto& [name, f] : {std::pair<std::string, double>{"camera.fx_px", bundle.camera.fx_px},
                                {"projector.x.f", bundle.projector->x ? bundle.projector->x->f : 1.0},
                                {"projector.y.f", bundle.projector->y ? bundle.projector->y->f : 1.0}}) {
    if (const std::string open = open_focal_length(report->covariance, name, f); !open.empty())
      return unanswerable(open);
  }

  method += fmt::format("; stated u of camera corners times {:.3g}, of projector coordinates times {:.3g}",
                        report->components.camera, report->components.projector);
  if (report->components.bow_mm > 0) {
    method += fmt::format(
        "; board bow {:+.3f} mm along x, {:+.3f} mm along y, twist {:+.3f} mm, bent by {:.3f} mm from pose to pose",
        bundle.bow_mm.x(), bundle.bow_mm.y(), bundle.bow_mm.z(), report->components.bend_mm);
  }
  if (bundle.flats > 0) {
    method +=
        fmt::format("; {} views of a flat: u times {:.3g}, {:.2g} {} rms, bow {:+.4f} {:+.4f} mm, twist {:+.4f} mm",
                    bundle.flats, report->components.flat, report->flat_rms, plan.code(main)->unit,
                    bundle.flat_bow_mm.x(), bundle.flat_bow_mm.y(), bundle.flat_bow_mm.z());
  }
  if (report->components.phase_offset > 0) {
    method += fmt::format("; captures' phases offset by {:.2g} {} rms", report->components.phase_offset,
                          plan.code(main)->unit);
  }

  if (report->pose_scatter > 0) {
    method += fmt::format("; scatter from pose to pose {:.2f} of what the covariance says (at most {:.2f} by chance)",
                          report->pose_scatter, report->pose_scatter_limit);
  }
  if (report->widened > 1) {
    method += fmt::format(
        ", so all standard uncertainties are widened by {:.1f}: the poses do not agree with one rigid "
        "board and one scanner{}",
        report->widened, worst_pose(bundle, observations));
  }

  Scanner scanner;
  scanner.camera = bundle.camera;
  scanner.camera.pixel_mm = options.pixel_mm;
  scanner.projector = *bundle.projector;
  scanner.proj_from_cam = bundle.proj_from_cam;
  scanner.working_distance_mm = options.working_distance_mm.value_or(mean_distance_mm(bundle));
  scanner.uncertainty = report->covariance;
  scanner.priors = priors_of(report->components, main);
  scanner.method = method;
  scanner.board = board;
  scanner.board_corners_mm = estimated_corners(board, bundle);
  const auto first_flat = bundle.cam_from_board.end() - bundle.flats;
  scanner.cam_from_board.assign(bundle.cam_from_board.begin(), first_flat);
  scanner.cam_from_flat.assign(first_flat, bundle.cam_from_board.end());
  if (bundle.flats > 0) {
    scanner.flats = options.flats;
    scanner.u_flatness_mm = options.u_flatness_mm;
  }
  fill_observations(scanner, observations, bundle, *report);
  auto& r = scanner.residuals;
  r.camera_rms_px = report->camera_rms_px;
  r.projector_rms = report->projector_rms;
  r.projector_unit = plan.code(main)->unit;
  r.grid_rms_mm = grid_rms_mm(bundle);
  r.chi2_per_dof = report->chi2_per_dof;
  for (const Sight& s : bundle.sights) {
    if (s.target != kOnFlat) ++(s.used ? r.corners_used : r.corners_rejected);
  }
  r.poses = static_cast<int>(observations.size());
  r.iterations = report->iterations;
  scanner.provenance = provenance_now();
  return scanner;
}

}  // namespace fringecal::calib
