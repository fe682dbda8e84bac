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

/// Closed form minus full model over places of the volume, root mean square in X, Y, Z. The places are given in world
/// here, not along pixels' rays as in the fit.
Eigen::Vector3d rms_xyz_mm(const model::Scanner& scanner, const Chen2008Model& closed) {
  const Rigid3 world_from_cam = scanner.world_from_cam(), proj_from_world = scanner.world_from_proj().inverse();
  const auto phase_at = [&](const Eigen::Vector3d& p) {
    return scanner.projector.x->code.phase_from_u(*scanner.projector.project(CodeAxis::x, proj_from_world * p));
  };
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  int n = 0;
  for (double x = -150; x <= 150; x += 30) {
    for (double y = -100; y <= 100; y += 25) {
      for (double z = -80; z <= 80; z += 32) {
        const Eigen::Vector3d place(x, y, z);
        const Eigen::Vector2d pixel = *scanner.camera.project(world_from_cam.inverse() * place);
        const Eigen::Vector3d& eye = world_from_cam.translation_mm;
        const Eigen::Vector3d on_R = eye + eye.z() / (eye.z() - z) * (place - eye);
        const auto point = closed.point_mm(pixel, phase_at(place), phase_at(on_R), true);
        squares += (point.value() - place).cwiseAbs2();
        ++n;
      }
    }
  }
  return (squares / n).cwiseSqrt();
}

TEST(FitChen2008, FindsTheClosedFormOfPixelsThatAreNotSquare) {
  // Unequal fx and fy have an exact closed form off the geometric one: sin(alpha') = fy/fx sin(alpha) and
  // f_C' cos(alpha') = fy cos(alpha) give eq. 13 its two numbers.
  auto scanner = ideal_scanner();
  scanner.camera.fy_px *= 1.004;
  auto geometric = model::chen2008_from(scanner);
  geometric.kc1_per_mm2 = geometric.kc2_per_mm4 = 0;  // the fit of eq. 18 would take part of the difference
  // The geometric f_C is the mean, 0.2 % off: of Y up to 100 mm, rms 65 mm, 0.13 mm.
  EXPECT_GT(rms_xyz_mm(scanner, geometric).y(), 0.1);
  const auto fitted = fit_chen2008(scanner, kVolume, PaperEquations::to_17);
  ASSERT_TRUE(fitted) << fitted.error().sentence;
  // At its minimum eq. 1 is at most what it is at the exact solution: rms <= lambda |(q* - q_0) / s|. There alpha is
  // off by 0.004 tan(alpha) = 1.6 mrad = 0.16 s, f_C by 0.002 + 0.0016 tan(alpha) = 0.26 % = 0.26 s: |.| = 0.31.
  EXPECT_LT(fitted->rms_mm(), 0.31 * kLambda_mm * 1.05);
  // Places between the samples: eq. 1's rms there is of the same smooth field, at most a few times as large.
  EXPECT_LT(rms_xyz_mm(scanner, fitted->model).norm(), 4 * 0.31 * kLambda_mm);
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
  RecordProperty("rms_with_mm", std::to_string(with->rms_mm()));
  RecordProperty("rms_without_mm", std::to_string(without->rms_mm()));
  // Lenses of 0.3 % of the field's edge: 0.29 mm rms are left without eqs. 18 to 20; with them, what two-term
  // polynomials differ from the inverse of two-term polynomials, the r^6 terms: 0.7 um (both by an independent
  // program).
  EXPECT_NEAR(without->rms_mm(), 0.295, 0.03);
  EXPECT_LT(with->rms_mm(), 0.002);
  EXPECT_EQ(without->model.kc1_per_mm2, 0);
  EXPECT_EQ(without->model.kp1_per_mm2, 0);
}

TEST(FitChen2008, TakesUpTheScaleOfACameraThatIsNotAtTheHeightOfTheProjector) {
  // The camera 2.4 mm below L, as a projector axis tilted by 0.4 deg makes it; lenses without distortion.
  auto scanner = ideal_scanner();
  auto world_from_cam = scanner.world_from_cam();
  world_from_cam.translation_mm.z() -= 2.4;
  scanner.proj_from_cam = scanner.world_from_proj().inverse() * world_from_cam;
  const auto geometric = rms_xyz_mm(scanner, model::chen2008_from(scanner));
  const auto fitted = fit_chen2008(scanner, kVolume, PaperEquations::to_17);
  ASSERT_TRUE(fitted) << fitted.error().sentence;
  // Geometric: Z is off by 2.4 / 1000 of Z, whose rms over the planes is 55 mm.
  EXPECT_NEAR(geometric.z(), 0.13, 0.05);
  // Fitted: b, L and p_R take up the scale; what is left is quadratic in the field.
  EXPECT_LT(rms_xyz_mm(scanner, fitted->model).z(), geometric.z() / 3);
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
