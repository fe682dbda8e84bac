// Calibrations through rendered images: the virtual scanner's boards, detected and decoded, with every effect that the model
// does not have (harmonics of binary fringes, step errors, flicker, blur, quantisation), against the known truth.
// FRINGECAL_LONG=60: 60 instruments instead of one (20 minutes of a core); each prints its line as it is done.
// FRINGECAL_OBSERVATIONS=folder keeps what was seen of each (rendering is nearly all of the time) and uses what is there.
//
// N instruments know a scatter to 1 / sqrt(2 N) only: 9 % of 60. Their captures know it better: the noise of one capture has
// nothing to do with that of another, and to first order (linear_error.h) an error is the sum of what each capture and what all
// of them together (printing, what a corner is off in every pose) put into it,
//   e = r + sum_j e_j,   s^2 = var(r) + sum_j var(e_j)                                                           (1)
// over the instruments; s is known to s / sqrt(2 (N - 1) n), n = (sum var)^2 / sum var^2, which is some 8 of 15 captures.
#include "calib/board_detection.h"
#include "calib/calibrate.h"
#include "hw/virtual/virtual_scanner.h"
#include "tests/calib/linear_error.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>

namespace fringecal {
namespace {

/// The observations of an instrument, rendered, or those that are kept.
Result<std::vector<model::BoardObservation>> observations_of(int seed) {
  const char* const folder = std::getenv("FRINGECAL_OBSERVATIONS");
  const std::filesystem::path kept =
      folder ? std::filesystem::path(folder) / fmt::format("instrument_{}.json", seed) : "";
  if (folder && std::filesystem::exists(kept)) return model::read_scanner(kept).observations;
  // An aligned grating: the misalignment that is left turns into step errors.
  const virt::VirtualScanner instrument("chen2008", static_cast<std::uint64_t>(seed), {.theta_mrad = 0.004});
  const virt::InstrumentState state;
  model::Scanner out = instrument.true_scanner(state);
  const model::Board board = instrument.certified_board("chessboard");
  for (int pose = 0; pose < instrument.calibration_scenes(); ++pose) {
    const auto scene = instrument.standard_scene(fmt::format("calibration {}", pose));
    const auto capture = instrument.capture(scene, state, static_cast<std::uint64_t>(1000 * seed + pose));
    auto observation = calib::observe_board(capture, board, fmt::format("pose {}", pose));
    if (!observation) return tl::unexpected(observation.error());
    out.observations.push_back(std::move(*observation));
  }
  out.cam_from_board.resize(out.observations.size());
  if (folder) {
    std::filesystem::create_directories(folder);
    model::write_scanner(kept, out);
  }
  return out.observations;
}

/// A calibration at the truth: exact readings, the uncertainties and components that it has found.
calib::Bundle bundle_at_truth(const virt::VirtualScanner& instrument, const model::Scanner& found) {
  const model::Scanner truth = instrument.true_scanner({});
  const model::Board& board = *found.board;
  const Rigid3 cam_from_preset = instrument.preset_from_cam({}).inverse();
  const Eigen::Vector3d middle = 0.5 * board.corner_mm(board.columns - 1, board.rows - 1);
  calib::Bundle b;
  b.camera = truth.camera;
  b.projector = truth.projector;
  b.proj_from_cam = truth.proj_from_cam;
  for (int i = 0; i < board.corners(); ++i)
    b.targets_mm.push_back(board.corner_mm(i % board.columns, i / board.columns).head<2>());
  for (const auto& observation : found.observations) {
    const int pose = static_cast<int>(b.cam_from_board.size());
    const auto scene = instrument.standard_scene(fmt::format("calibration {}", pose));
    const auto& shape = std::get<virt::PatternBoard>(scene.objects[0].shape);
    const auto corners = instrument.true_corners_mm(shape);
    const Rigid3 cam_from_middle = cam_from_preset * scene.objects[0].world_from_part;
    const double scale = 1.0 + shape.pitch_error_relative;
    b.cam_from_board.push_back({cam_from_middle.rotation, cam_from_middle * Eigen::Vector3d(-scale * middle)});
    if (pose == 0) {
      b.pitch_error = shape.pitch_error_relative;
      b.bow_mm << shape.bow_mm * middle.head<2>().cwiseAbs2() / middle.squaredNorm(), 0.0;
      for (std::size_t i = 0; i < corners.size(); ++i) {
        b.print_mm.emplace_back(Eigen::Vector3d::Zero());
        b.print_mm.back().head<2>() = corners[i].head<2>() / scale + middle.head<2>() - b.targets_mm[i];
      }
    }
    for (const auto& c : observation.corners) {
      const int target = c.row * board.columns + c.column;
      const Eigen::Vector3d place = cam_from_middle * corners[static_cast<std::size_t>(target)];
      calib::Sight s{pose, target, truth.camera.project(place).value(), c.u_pixel_px, c.x, std::nullopt, c.used};
      if (s.x) s.x->value = truth.projector.project(CodeAxis::x, truth.proj_from_cam * place).value();
      b.sights.push_back(s);
    }
  }
  return b;
}

calib::Components components_of(const model::Scanner& found) {
  const auto u = [&](const char* name) {
    for (const auto& prior : found.priors) {
      if (prior.parameter == name) return prior.u;
    }
    return 0.0;
  };
  return {.print_mm = u("board.print_error_mm"),
          .relief_mm = u("board.relief_mm"),
          .bend_mm = u("board.bend_mm"),
          .phase_offset = u("capture.phase_offset"),
          .pitch = u("board.pitch_relative_error"),
          .bow_mm = u("board.bow_mm"),
          .along_mm = u("proj_from_cam.translation_y_mm")};
}

/// The terms of eq. 1 over the stated uncertainties: one column per capture, then r.
Eigen::MatrixXd parts_of_error(const virt::VirtualScanner& instrument, const model::Scanner& found) {
  const test::LinearErrors linear(
      bundle_at_truth(instrument, found),
      {.camera = calib::DistortionTerms::radial_tangential, .projector = calib::DistortionTerms::radial},
      components_of(found));
  const calib::Bundle& truth = linear.truth();
  std::vector<Eigen::Vector2d> pixel, common(truth.targets_mm.size(), Eigen::Vector2d::Zero());
  std::vector<double> phase;  // its error at the pixel where it was read
  const auto poses = static_cast<double>(found.observations.size());
  for (const auto& observation : found.observations) {
    for (const auto& c : observation.corners) {
      const calib::Sight& s = truth.sights[pixel.size()];
      pixel.push_back(c.pixel - s.pixel);
      phase.push_back(c.x ? c.x->value - s.x->value - s.u_by_pixel.row(0).dot(pixel.back()) : 0.0);
      common[static_cast<std::size_t>(s.target)] += pixel.back() / poses;
    }
  }
  const auto error_of = [&](auto&& pixel_error, auto&& phase_error) {
    calib::Bundle read = truth;
    for (std::size_t i = 0; i < read.sights.size(); ++i) {
      calib::Sight& s = read.sights[i];
      const Eigen::Vector2d off = pixel_error(i, s);
      s.pixel += off;
      if (s.x) s.x->value += s.u_by_pixel.row(0).dot(off) + phase_error(i, s);
    }
    return linear.of(read);
  };
  const auto no_pixel = [](std::size_t, const calib::Sight&) -> Eigen::Vector2d { return Eigen::Vector2d::Zero(); };
  const auto no_phase = [](std::size_t, const calib::Sight&) { return 0.0; };
  const Eigen::VectorXd of_priors = error_of(no_pixel, no_phase);
  Eigen::MatrixXd out(of_priors.size(), static_cast<Eigen::Index>(poses) + 1);
  for (int pose = 0; pose < out.cols() - 1; ++pose) {
    out.col(pose) =
        error_of(
            [&](std::size_t i, const calib::Sight& s) -> Eigen::Vector2d {
              if (s.pose != pose) return Eigen::Vector2d::Zero();
              // The mean over the poses has a share of each.
              return std::sqrt(poses / (poses - 1)) * (pixel[i] - common[static_cast<std::size_t>(s.target)]);
            },
            [&](std::size_t i, const calib::Sight& s) { return s.pose == pose ? phase[i] : 0.0; }) -
        of_priors;
  }
  out.rightCols<1>() = error_of(
      [&](std::size_t, const calib::Sight& s) -> Eigen::Vector2d { return common[static_cast<std::size_t>(s.target)]; },
      no_phase);
  for (Eigen::Index k = 0; k < out.rows(); ++k) out.row(k) /= std::sqrt(found.uncertainty.covariance(k, k));
  return out;
}

/// Eq. 1 of a parameter, what it is known to, and the mean error.
struct ByCaptures {
  double scatter = 0, u = 0, mean = 0;
};
ByCaptures scatter_by_captures(const std::vector<Eigen::MatrixXd>& parts, Eigen::Index parameter) {
  const auto n = static_cast<double>(parts.size());
  Eigen::MatrixXd terms(static_cast<Eigen::Index>(parts.size()), parts.front().cols());
  for (std::size_t i = 0; i < parts.size(); ++i) terms.row(static_cast<Eigen::Index>(i)) = parts[i].row(parameter);
  const Eigen::RowVectorXd mean = terms.colwise().mean(),
                           variance = (terms.rowwise() - mean).colwise().squaredNorm() / (n - 1.0);
  const double scatter = std::sqrt(variance.sum()), independent = std::pow(variance.sum(), 2) / variance.squaredNorm();
  return {scatter, scatter / std::sqrt(2.0 * (n - 1.0) * independent), mean.sum()};
}

TEST(RenderedCalibration, ErrsAsItsCovarianceSays) {
  const char* const asked = std::getenv("FRINGECAL_LONG");
  const int instruments = asked ? std::max(2, std::atoi(asked)) : 1;
  std::vector<std::string> names;
  Eigen::VectorXd squares;
  double sum = 0;
  std::vector<Eigen::MatrixXd> parts;
  for (int seed = 1; seed <= instruments; ++seed) {
    const virt::VirtualScanner instrument("chen2008", static_cast<std::uint64_t>(seed), {.theta_mrad = 0.004});
    const model::Scanner truth = instrument.true_scanner({});
    const model::Board board = instrument.certified_board("chessboard");
    const auto seen = observations_of(seed);
    ASSERT_TRUE(seen) << seen.error().sentence;
    const auto found =
        calib::calibrate(*seen, board, instrument.camera_data().width_px, instrument.camera_data().height_px,
                         instrument.plan(), {.camera_terms = calib::DistortionTerms::radial_tangential});
    ASSERT_TRUE(found) << found.error().sentence;
    // Good corners are not left out: 4 standard deviations of 1620 corners with three readings each.
    EXPECT_LE(found->residuals.corners_rejected, 16);
    names = found->uncertainty.names;
    const Eigen::Vector3d w =
        vector_from_rotation(found->proj_from_cam.rotation * truth.proj_from_cam.rotation.conjugate());
    if (squares.size() == 0) squares.setZero(static_cast<Eigen::Index>(names.size()));
    if (seed == 1) {
      std::printf("errors / u of");
      for (const auto& name : names) std::printf(" %s", name.c_str());
      std::printf("\n");
    }
    std::printf("instrument %d:", seed);
    for (std::size_t k = 0; k < names.size(); ++k) {
      const auto rotation = names[k].find("rotation_");
      const double error = rotation == std::string::npos
                               ? found->value_of(names[k]) - truth.value_of(names[k])
                               : w[names[k][rotation + std::string("rotation_").size()] - 'x'];
      const double z = error / *found->uncertainty.u(names[k]);
      squares[static_cast<Eigen::Index>(k)] += z * z / instruments;
      std::printf(" %+.2f", z);
      // One instrument: 18 parameters, 4 of their own standard uncertainties each.
      EXPECT_LT(std::abs(z), 4.0) << names[k] << ", instrument " << seed;
    }
    std::printf("\n");
    std::fflush(stdout);
    if (instruments > 1) parts.push_back(parts_of_error(instrument, *found));
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    const double sd = std::sqrt(squares[static_cast<Eigen::Index>(k)]);
    sum += sd * sd / static_cast<double>(names.size());
    std::printf("%-34s normalised sd %.3f", names[k].c_str(), sd);
    if (instruments > 1) {
      // 0.8 .. 1.25 is asked; what chance does to N instruments, 3.3 / sqrt(2 N), is more than that below 87.
      EXPECT_NEAR(sd, 1.0, std::max(0.25, 3.3 / std::sqrt(2.0 * instruments))) << names[k];
      const auto [by_captures, u, bias] = scatter_by_captures(parts, static_cast<Eigen::Index>(k));
      std::printf(", by captures %.3f +- %.3f, mean %+.2f +- %.2f", by_captures, u, bias,
                  1.0 / std::sqrt(static_cast<double>(instruments)));
      EXPECT_GT(by_captures + 3.3 * u, 0.8) << names[k];
      EXPECT_LT(by_captures - 3.3 * u, 1.25) << names[k];
    }
    std::printf("\n");
  }
  std::printf("%d instruments, all parameters %.3f\n", instruments, std::sqrt(sum));
}

}  // namespace
}  // namespace fringecal
