// The paper's closed form fitted to full models: geometries that obey its assumptions, and one that does not.
#include "calib/fit_chen2008.h"

#include "tests/metrology/exact_phase_map.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

namespace fringecal::calib {
namespace {

using model::Chen2008Model;
using test::ideal_scanner;
using test::sample_scanner;

constexpr WorkingVolume kVolume{-80, 80};
constexpr double kLambda_mm = 1e-4;  // of eq. 1

TEST(FitChen2008, GivesTheGeometricParametersWhereThePapersGeometryIsExact) {
  const auto scanner = ideal_scanner();
  const auto geometric = model::chen2008_from(scanner);
  for (const auto equations : {PaperEquations::to_17, PaperEquations::to_20}) {
    const auto fitted = fit_chen2008(scanner, kVolume, equations);
    ASSERT_TRUE(fitted) << fitted.error().sentence;
    // The samples' own rounding: 1e3 mm in double through two models, 1e-12 mm, over a sine of 0.37 and (b + S) / b.
    EXPECT_LT(fitted->max_mm, 1e-6);
    const Chen2008Model& m = fitted->model;
    // Directions that the samples leave open are held by the damping at the geometric values: rounding of 1e-11 mm over
    // lambda of 1e-4 mm per s = 10 mm is 1e-6 mm; the other scales likewise.
    EXPECT_NEAR(m.L_mm, geometric.L_mm, 1e-6);
    EXPECT_NEAR(m.b_mm, geometric.b_mm, 1e-6);
    EXPECT_NEAR(m.alpha_rad, geometric.alpha_rad, 1e-9);
    EXPECT_NEAR(m.p_R_mm, geometric.p_R_mm, 1e-8);
    EXPECT_NEAR(m.phi_O_rad, geometric.phi_O_rad, 1e-7);
    EXPECT_NEAR(m.f_C_mm, geometric.f_C_mm, 1e-7);
    EXPECT_NEAR(m.i_C_px, geometric.i_C_px, 1e-6);
    EXPECT_NEAR(m.j_C_px, geometric.j_C_px, 1e-6);
  }
}

TEST(FitChen2008, FindsTheClosedFormOfPixelsThatAreNotSquare) {
  // Eq. 13 holds two numbers of f_C, alpha, j_C, so unequal fx and fy have an exact closed form, off the geometric one.
  auto scanner = ideal_scanner();
  scanner.camera.fy_px *= 1.004;
  const auto geometric = model::chen2008_from(scanner);
  // The geometric f_C is the mean, 0.2 % off in each direction: at 100 mm up the image 0.2 mm in Y.
  const auto ray = scanner.camera.ray({160, 40});
  ASSERT_TRUE(ray);
  const Eigen::Vector3d d = scanner.world_from_cam().rotation * *ray;
  const Eigen::Vector3d on_R = scanner.world_from_cam().translation_mm - 1000 / d.z() * d;
  const double phi = scanner.projector.x->code.phase_from_u(
      *scanner.projector.project(CodeAxis::x, scanner.world_from_proj().inverse() * on_R));
  const auto point = geometric.point_mm({160, 40}, phi, phi, false);
  ASSERT_TRUE(point);
  EXPECT_GT(std::abs(point->y() - on_R.y()), 0.1);
  const auto fitted = fit_chen2008(scanner, kVolume, PaperEquations::to_17);
  ASSERT_TRUE(fitted) << fitted.error().sentence;
  // At the minimum eq. 1 is at most what the exact solution has: rms <= lambda |(q* - q_0) / s|. The exact solution
  // with alpha kept moves f_C by 0.2 s and j_C to keep B / A: A changes by 0.2 %, so tan(beta) by 0.2 % of f_C /
  // tan(alpha) = 4.3 px, 0.43 s, and again f_C for it: within |.| = 1.
  EXPECT_LT(fitted->rms_mm, kLambda_mm);
  EXPECT_GT(std::abs(fitted->model.f_C_mm - geometric.f_C_mm) + std::abs(fitted->model.j_C_px - geometric.j_C_px),
            1e-3);
}

/// The paper's geometry with the lenses of the default virtual instrument.
model::Scanner distorted_scanner() {
  auto scanner = ideal_scanner();
  // 24 mm on a sensor of 9 mm, as there: the same field angles as the default instrument's.
  scanner.camera.distortion = {-0.10, 0.06, 0, 0, 0};
  scanner.projector.distortion = {-0.08, 0.03, 0, 0, 0};
  return scanner;
}

TEST(FitChen2008, DistortionTermsBringWhatTheLensesTake) {
  const auto scanner = distorted_scanner();
  const auto with = fit_chen2008(scanner, kVolume, PaperEquations::to_20);
  const auto without = fit_chen2008(scanner, kVolume, PaperEquations::to_17);
  ASSERT_TRUE(with && without);
  RecordProperty("rms_with_mm", std::to_string(with->rms_mm));
  RecordProperty("rms_without_mm", std::to_string(without->rms_mm));
  EXPECT_GT(without->rms_mm, 10 * with->rms_mm);
  EXPECT_EQ(without->model.kc1_per_mm2, 0);
  EXPECT_EQ(without->model.kp1_per_mm2, 0);
}

TEST(FitChen2008, BeatsTheGeometricParametersOnARealGeometry) {
  const auto scanner = sample_scanner();
  const auto fitted = fit_chen2008(scanner, kVolume, PaperEquations::to_20);
  const auto geometric = model::chen2008_from(scanner);
  ASSERT_TRUE(fitted) << fitted.error().sentence;
  EXPECT_GT(fitted->samples, 3000);  // 24 x 18 x 9 = 3888, all but the corners lit
  EXPECT_NE(fitted->model.L_mm, geometric.L_mm);
}

TEST(FitChen2008, IsTheSameEveryTime) {
  const auto scanner = sample_scanner();
  const auto a = fit_chen2008(scanner, kVolume, PaperEquations::to_20);
  const auto b = fit_chen2008(scanner, kVolume, PaperEquations::to_20);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(to_json(to_value(*a)), to_json(to_value(*b)));
}

TEST(FitChen2008, RefusesAVolumeWithoutDepthAndABaseLineAlongTheFringes) {
  auto scanner = sample_scanner();
  const auto flat = fit_chen2008(scanner, {-2, 2}, PaperEquations::to_20);
  ASSERT_FALSE(flat);
  EXPECT_NE(flat.error().sentence.find("-2.00 mm to 2.00 mm"), std::string::npos);
  scanner.proj_from_cam.translation_mm.x() = 3;
  EXPECT_FALSE(fit_chen2008(scanner, kVolume, PaperEquations::to_20));
}

TEST(ScannerFile, KeepsBothFittedSetsAndReadsFilesWithoutThem) {
  auto scanner = sample_scanner();
  const test::TemporaryFolder folder;
  scanner.uncertainty.covariance.resize(0, 0);
  model::write_scanner(folder.path() / "old.json", scanner);
  const auto old = model::read_scanner(folder.path() / "old.json");
  EXPECT_FALSE(old.paper_model || old.paper_ideal_model);
  scanner.paper_model = *fit_chen2008(scanner, kVolume, PaperEquations::to_20);
  scanner.paper_ideal_model = *fit_chen2008(scanner, kVolume, PaperEquations::to_17);
  model::write_scanner(folder.path() / "new.json", scanner);
  const auto back = model::read_scanner(folder.path() / "new.json");
  ASSERT_TRUE(back.paper_model && back.paper_ideal_model);
  EXPECT_EQ(to_json(to_value(*back.paper_model)), to_json(to_value(*scanner.paper_model)));
  EXPECT_EQ(to_json(to_value(*back.paper_ideal_model)), to_json(to_value(*scanner.paper_ideal_model)));
  EXPECT_EQ(back.paper_model->model.axis, CodeAxis::x);
}

}  // namespace
}  // namespace fringecal::calib
