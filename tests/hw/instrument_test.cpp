#include "core/error.h"
#include "hw/virtual/free_form.h"
#include "hw/virtual/scene_distance.h"
#include "tests/hw/virtual_support.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>

namespace fringecal::virt {
namespace {

std::string sentence_of(const Changes& changes, const std::string& extra = "") {
  const ChangedPreset file(changes);
  if (!extra.empty()) std::ofstream(file.file(), std::ios::app) << extra;
  try {
    read_preset(file.file());
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(Preset, RefusesWhatItCannotUseByName) {
  EXPECT_THAT(sentence_of({}, "\nblurr = 3\n"), testing::HasSubstr("blurr"));
  EXPECT_THAT(sentence_of({{"bits", "10"}}), testing::HasSubstr("8 or 12"));
  EXPECT_THAT(sentence_of({{"period_mm", "-1.0"}}), testing::HasSubstr("period_mm"));
  EXPECT_THAT(sentence_of({{"order", "\"mixed\""}}), testing::HasSubstr("gray first"));
  EXPECT_THROW(read_preset("no_such_preset"), InputError);
}

// Resolution 0.005, backlash 0.05, so after a reversal 0.05 of the turn is lost. The scale error is common to all
// turns.
TEST(Adjuster, LosesItsBacklashAtAReversalAndScalesTheRest) {
  VirtualScanner scanner("chen2008", 4);
  InstrumentState state;
  const auto theta = [&] { return 1e3 * scanner.true_theta_rad(state); };
  EXPECT_NEAR(theta(), 0.80, 1e-12);
  scanner.turn_adjuster(-0.5, state);
  const double scale = (0.80 - theta()) / 0.5;
  EXPECT_NEAR(scale, 1.0, 0.12);  // four sigma of 3 %
  EXPECT_NE(scale, 1.0);
  scanner.turn_adjuster(+0.04, state);
  EXPECT_NEAR(theta(), 0.80 - 0.5 * scale, 1e-12);  // still within the play
  scanner.turn_adjuster(+0.11, state);
  EXPECT_NEAR(theta(), 0.80 - 0.4 * scale, 1e-12);
  scanner.turn_adjuster(-0.05, state);
  EXPECT_NEAR(theta(), 0.80 - 0.4 * scale, 1e-12);
  scanner.turn_adjuster(-0.1012, state);  // the screw stands on steps of 0.005
  EXPECT_NEAR(theta(), 0.80 - 0.5 * scale, 1e-12);
}

// The specification: +8 um and +20 urad, time constant 25 min.
TEST(WarmUp, MovesTheBaseAndTurnsTheCamera) {
  const VirtualScanner scanner("chen2008", 1);
  const Rigid3 cold = scanner.preset_from_cam({.minutes_since_start = 0}), warm = scanner.preset_from_cam({});
  const Rigid3 after_25 = scanner.preset_from_cam({.minutes_since_start = 25});
  EXPECT_NEAR(warm.translation_mm.x() - cold.translation_mm.x(), 0.008, 1e-12);
  EXPECT_NEAR(after_25.translation_mm.x() - cold.translation_mm.x(), 0.008 * (1 - std::exp(-1.0)), 1e-12);
  EXPECT_NEAR(warm.rotation.angularDistance(cold.rotation), 20e-6, 1e-9);
}

// Pupils at b and 3 mm, the projector's axis 0.4 deg off, so the two worlds differ by that angle.
TEST(Geometry, IsThatOfTheSpecification) {
  const VirtualScanner scanner("chen2008", 1);
  const InstrumentState cold{.minutes_since_start = 0};
  const model::Scanner truth = scanner.true_scanner(cold);
  EXPECT_NEAR(truth.base_mm(), std::hypot(400.0, 3.0), 1e-9);
  const Rigid3 preset_from_proj = scanner.preset_from_cam(cold) * truth.proj_from_cam.inverse();
  const Eigen::Vector3d axis = preset_from_proj.rotation * Eigen::Vector3d::UnitZ();
  const double tilt = 0.4 * M_PI / 180;
  EXPECT_NEAR(axis.x(), std::sin(tilt) * std::cos(M_PI / 6), 1e-12);
  EXPECT_NEAR(axis.y(), std::sin(tilt) * std::sin(M_PI / 6), 1e-12);
  EXPECT_NEAR((preset_from_proj.rotation * Eigen::Vector3d::UnitX()).x(), 1.0, 1e-4);
  const auto middle = truth.camera.project(scanner.preset_from_cam(cold).inverse() * Eigen::Vector3d(0, 3, 0));
  EXPECT_NEAR(middle->x(), 695.5 + 0.08 / 0.00645, 1e-6);
  EXPECT_NEAR(middle->y(), 519.5 - 0.05 / 0.00645, 1e-6);
  EXPECT_NEAR(truth.projector.x->u0, 7.68 + 0.15, 1e-12);
}

// U = 1 um (k = 2): a draw beyond 5 u = 2.5 um has a chance of 6e-7. The certificates of ten instruments scatter.
TEST(Certificates, DifferFromTheTruthByTheirUncertainty) {
  const ChangedPreset small({{"width_px", "16"}, {"height_px", "16"}});
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const VirtualScanner scanner(small.file(), seed);
    const Uncertain certificate = scanner.certificate_mm("sphere30");
    const Scene scene = scanner.standard_scene("spheres 0");
    const double truth = std::get<Sphere>(scene.objects.at(0).shape).diameter_mm;
    EXPECT_DOUBLE_EQ(certificate.u, 0.0005);
    EXPECT_NE(truth, certificate.value);
    EXPECT_NEAR(truth, certificate.value, 0.0025);
  }
}

TEST(StandardScenes, BoardsStayInsideTheImageAndOnLitGround) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const VirtualScanner scanner("chen2008", seed);
    const model::Scanner truth = scanner.true_scanner({});
    ASSERT_EQ(scanner.calibration_scenes(), 15);
    for (int k = 0; k < 15; ++k) {
      const Scene scene = scanner.standard_scene("calibration " + std::to_string(k));
      const auto& object = scene.objects.at(0);
      const auto& board = std::get<PatternBoard>(object.shape).board;
      const double x = (0.5 * (board.columns - 1) + 1.25) * board.pitch_x_mm,
                   y = (0.5 * (board.rows - 1) + 1.25) * board.pitch_y_mm;
      for (const auto& [a, b] : {std::pair(-x, -y), std::pair(x, -y), std::pair(-x, y), std::pair(x, y)}) {
        const Eigen::Vector3d in_cam =
            scanner.preset_from_cam({}).inverse() * (object.world_from_part * Eigen::Vector3d(a, b, 0));
        const auto pixel = truth.camera.project(in_cam).value();
        EXPECT_TRUE(pixel.x() > 3 && pixel.y() > 3 && pixel.x() < 1388 && pixel.y() < 1036)
            << k << ": " << pixel.transpose();
        const double u = truth.projector.project(CodeAxis::x, truth.proj_from_cam * in_cam).value();
        EXPECT_TRUE(u > 0.1 && u < 15.26) << k << ": " << u;
      }
    }
  }
}

// A hand puts things back elsewhere, within five of its scatter in each coordinate; the carrier keeps what stands on it.
TEST(StandardScenes, AreLaidOutAnewByAnotherPlacing) {
  const VirtualScanner scanner("chen2008", 1);
  const auto at = [&](const std::string& name, std::uint64_t placing) {
    return scanner.standard_scene(name, 20, placing).objects.front().world_from_part.translation_mm;
  };
  for (const char* name : {"probing 2", "sphere_plate 1", "step 0", "turned_bar 2.1"}) {
    EXPECT_EQ(at(name, 1), scanner.standard_scene(name).objects.front().world_from_part.translation_mm) << name;
    EXPECT_NE(at(name, 1), at(name, 2)) << name;
    EXPECT_LT((at(name, 1) - at(name, 2)).norm(), 20) << name;
  }
  const auto first = scanner.standard_scene("turned_bar 2.0").objects,
             second = scanner.standard_scene("turned_bar 2.1").objects;
  ASSERT_EQ(first.size(), 11u);  // two spheres, a rod, eight references
  const auto apart = [](const std::vector<SceneObject>& objects) {
    return (objects[0].world_from_part.translation_mm - objects[7].world_from_part.translation_mm).norm();
  };
  EXPECT_NEAR(apart(first), apart(second), 1e-9);
  EXPECT_GT((first[0].world_from_part.translation_mm - second[0].world_from_part.translation_mm).norm(), 1);
}

// Off each surface by h along its normal the distance is h; of the free form to second order, h^2 / 2R with R above 20 mm.
TEST(SceneDistance, IsThatOfTheNearestSurface) {
  const VirtualScanner scanner("chen2008", 1);
  const Scene scene = scanner.standard_scene("plaster 3");
  const auto distance = distance_from(scene);
  const SceneObject& plaster = scene.objects.front();
  const FreeForm form = std::get<FreeForm>(plaster.shape);
  const FreeFormSurface surface({form.length_mm / 2, form.height_mm / 2, form.depth_mm / 2}, form.relief,
                                static_cast<std::uint64_t>(form.seed));
  for (const Eigen::Vector3d& towards :
       {Eigen::Vector3d(1, 0.2, 0.3), Eigen::Vector3d(-0.5, -1, 0.4), Eigen::Vector3d(0, 0.3, -1)}) {
    const Eigen::Vector3d out = towards.normalized();
    const Eigen::Vector3d foot = (1000 - surface.hit(1000 * out, -out, 0).value()) * out;
    for (const double h : {-0.2, 0.0, 0.2}) {
      const Eigen::Vector3d p = plaster.world_from_part * Eigen::Vector3d(foot + h * surface.normal(foot));
      EXPECT_NEAR(distance(p), h, 0.2 * 0.2 / (2 * 20) + 1e-6);
    }
  }
  const SceneObject& sphere = scene.objects.back();
  const double radius = std::get<Sphere>(sphere.shape).diameter_mm / 2;
  EXPECT_NEAR(distance(sphere.world_from_part * Eigen::Vector3d(0, radius + 0.3, 0)), 0.3, 1e-9);
}

TEST(StandardScenes, RefuseAnotherName) {
  const VirtualScanner scanner("chen2008", 1);
  for (const char* name : {"sphere 0", "calibration 15", "plane", "plane x", "alignment 1", "turned_bar 0",
                           "turned_bar 0.9", "turned_bar 9.0", "turned_sphere 0.0.0", "step 9", ""}) {
    EXPECT_THROW(scanner.standard_scene(name), std::logic_error) << name;
  }
}

std::string hash_of(const Capture& capture) {
  std::string bytes;
  for (const GrayImage& frame : capture.frames) {
    std::visit(
        [&](const auto& i) { bytes.append(reinterpret_cast<const char*>(i.data()), i.size() * sizeof(*i.data())); },
        frame);
  }
  return sha256_hex(bytes);
}

TEST(Determinism, AStackIsAFunctionOfItsSeeds) {
  const ChangedPreset file({{"width_px", "300"}, {"height_px", "200"}});
  const VirtualScanner scanner(file.file(), 1), other(file.file(), 2);
  const Scene scene = scanner.standard_scene("calibration 0");
  const std::string first = hash_of(scanner.capture(scene, {}, 1));
  EXPECT_EQ(first, hash_of(scanner.capture(scene, {}, 1)));
  EXPECT_NE(first, hash_of(scanner.capture(scene, {}, 2)));
  EXPECT_NE(first, hash_of(other.capture(scene, {}, 1)));
  RecordProperty("hash", first);
  std::printf("stack %s\n", first.c_str());
}

// The thread count is read once per process, so this program is run twice more.
TEST(Determinism, AStackDoesNotDependOnTheNumberOfThreads) {
  const auto hash_with = [](const std::string& threads) {
    const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
    const std::string command =
        "FRINGECAL_THREADS=" + threads + " '" + self + "' --gtest_filter=Determinism.AStackIsAFunctionOfItsSeeds";
    std::string out;
    FILE* pipe = ::popen(command.c_str(), "r");
    if (pipe == nullptr) return out;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) out += static_cast<char>(c);
    ::pclose(pipe);
    const auto at = out.find("\nstack ");
    return at == std::string::npos ? std::string() : out.substr(at + 7, 64);
  };
  const std::string serial = hash_with("1");
  EXPECT_EQ(serial.size(), 64U);
  EXPECT_EQ(serial, hash_with("3"));
}

}  // namespace
}  // namespace fringecal::virt
