// Calibrations through rendered images: the virtual scanner's boards, detected and decoded, with every effect that the model
// does not have (harmonics of binary fringes, step errors, flicker, blur, quantisation), against the known truth.
// FRINGECAL_LONG=60: 60 instruments instead of one (20 minutes of a core); each prints its line as it is done.
// FRINGECAL_OBSERVATIONS=folder keeps what was seen of each (rendering is nearly all of the time) and uses what is there.
#include "calib/board_detection.h"
#include "calib/calibrate.h"
#include "hw/virtual/virtual_scanner.h"

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

TEST(RenderedCalibration, ErrsAsItsCovarianceSays) {
  const char* const asked = std::getenv("FRINGECAL_LONG");
  const int instruments = asked ? std::max(2, std::atoi(asked)) : 1;
  std::vector<std::string> names;
  Eigen::VectorXd squares;
  double sum = 0;
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
  }
  for (std::size_t k = 0; k < names.size(); ++k) {
    const double sd = std::sqrt(squares[static_cast<Eigen::Index>(k)]);
    sum += sd * sd / static_cast<double>(names.size());
    std::printf("%-34s normalised sd %.3f\n", names[k].c_str(), sd);
    // 0.8 .. 1.25 is asked of 60; fewer scatter more: 3.3 / sqrt(2 N).
    if (instruments > 1) {
      EXPECT_NEAR(sd, 1.0, std::max(0.25, 3.3 / std::sqrt(2.0 * instruments))) << names[k];
    }
  }
  std::printf("%d instruments, all parameters %.3f\n", instruments, std::sqrt(sum));
}

}  // namespace
}  // namespace fringecal
