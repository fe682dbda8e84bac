#include "cli/calibrate_corners.h"

#include "calib/corner_files.h"
#include "calib/joint_solve.h"
#include "calib/lens_files.h"
#include "calib/tsai.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

namespace fringecal::cli {
namespace {

using calib::DistortionTerms;

struct Line {
  std::string name;
  double value = 0, u = 0;
};

struct Solved {
  model::Camera camera;
  std::vector<Line> lines;
  double rms_px = 0;
  std::string method;
};

double value_of(const calib::CameraSolution& s, const std::string& name) {
  const auto& c = s.camera;
  const std::pair<const char*, double> values[] = {
      {"fx_px", c.fx_px},      {"fy_px", c.fy_px},      {"cx_px", c.cx_px},      {"cy_px", c.cy_px},
      {"k1", c.distortion[0]}, {"k2", c.distortion[1]}, {"p1", c.distortion[2]}, {"p2", c.distortion[3]},
      {"k3", c.distortion[4]}, {"skew_px", s.skew_px}};
  for (const auto& [known, value] : values) {
    if (name == known) return value;
  }
  throw std::logic_error("broken contract: a camera's parameters are known by name");
}

Solved by_least_squares(const std::vector<calib::PlanarView>& views, const CornerOptions& o, int width, int height) {
  calib::CameraSolveOptions how;
  how.terms = o.terms == DistortionTerms::automatic ? DistortionTerms::radial : o.terms;
  how.skew = o.skew ? calib::Skew::free : calib::Skew::zero;
  how.aspect = o.one_focal_length ? calib::Aspect::one : calib::Aspect::free;
  const auto found = calib::solve_camera(views, width, height, how);
  if (!found) throw InputError(fmt::format("{}: {}", o.corners.front().string(), found.error().sentence));
  Solved out{found->camera,
             {},
             found->rms_px,
             fmt::format("least squares, every corner with the same weight; terms {}", calib::name_of(how.terms))};
  for (std::size_t i = 0; i < found->names.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    out.lines.push_back({found->names[i], value_of(*found, found->names[i]), std::sqrt(found->covariance(k, k))});
  }
  return out;
}

Solved by_tsai(const std::vector<calib::PlanarView>& views, const CornerOptions& o, int width, int height) {
  const auto found = calib::calibrate_tsai(views, width, height);
  if (!found) throw InputError(fmt::format("{}: {}", o.corners.front().string(), found.error().sentence));
  const auto& c = found->camera;
  const auto u = [&](Eigen::Index i) { return std::sqrt(found->covariance(i, i)); };
  return {c,
          {{"f_px", c.fx_px, u(0)}, {"k1", c.distortion[0], u(1)}, {"k2", c.distortion[1], u(2)}},
          found->rms_px,
          "Tsai's two stages, the principal point in the image's middle; u of stage 2 alone"};
}

}  // namespace

void print_cross_check(const std::vector<calib::PlanarView>& views, int width_px, int height_px, DistortionTerms terms,
                       calib::OtherSolver solver) {
  const char* const name = solver == calib::OtherSolver::mrcal ? "mrcal" : "OpenCV";
  const auto found = calib::cross_check(views, width_px, height_px, terms, solver);
  if (!found) throw InputError(fmt::format("--cross-check: {}", found.error().sentence));
  const auto &a = found->ours.camera, &b = found->theirs.camera;
  fmt::print("cross-check, the same corners by plain least squares, terms {}: fringecal, {}, difference\n",
             calib::name_of(found->terms), name);
  const auto line = [](const char* what, double ours, double theirs) {
    fmt::print("  {:<6}{:>18.9g}{:>18.9g}{:>12.2g}\n", what, ours, theirs, theirs - ours);
  };
  line("fx_px", a.fx_px, b.fx_px);
  line("fy_px", a.fy_px, b.fy_px);
  line("cx_px", a.cx_px, b.cx_px);
  line("cy_px", a.cy_px, b.cy_px);
  const char* const terms_names[] = {"k1", "k2", "p1", "p2", "k3"};
  for (std::size_t i = 0; i < 5; ++i) {
    if (a.distortion[i] != 0 || b.distortion[i] != 0) line(terms_names[i], a.distortion[i], b.distortion[i]);
  }
  fmt::print(
      "  sum of squares {:.12g}, {:.12g} px^2; the same ray differs by {:.2g} px rms, {:.2g} px at most over the "
      "image: "
      "{:.2g} mm at {:.0f} mm\n",
      found->ours.squares_px2, found->theirs.squares_px2, found->rms_px, found->max_px, found->max_mm,
      found->distance_mm);
}

void calibrate_corners(const CornerOptions& o) {
  if (o.image_size.size() != 2) throw InputError("--corners needs --image-size WIDTH HEIGHT, the camera's, in px");
  if (o.board.empty() == o.places.empty()) throw InputError("--corners needs either --board or --places");
  const int width = o.image_size[0], height = o.image_size[1];
  const auto places =
      o.places.empty() ? calib::places_of(model::read_board(o.board)) : calib::read_places(o.places, o.places_unit_mm);
  std::vector<calib::PlanarView> views;
  for (auto& named : calib::read_corners(o.corners, places)) views.push_back(std::move(named.view));
  if (views.empty()) throw InputError(fmt::format("{}: no view with a board", o.corners.front().string()));
  const Solved s = o.tsai ? by_tsai(views, o, width, height) : by_least_squares(views, o, width, height);
  if (!o.output.empty()) {
    const auto format = std::filesystem::path(o.output).extension() == ".cameramodel" ? calib::LensFormat::mrcal
                                                                                      : calib::LensFormat::opencv;
    if (o.skew) throw InputError("a camera with a skew has no place in a lens file; leave out --skew or -o");
    write_atomically(o.output, calib::lens_file({s.camera, {}}, format, "fringecal calibrate --corners"));
  }
  if (o.json) {
    Value parameters = Value::object();
    for (const auto& l : s.lines) parameters.set(l.name, Value::object().set("value", l.value).set("u", l.u));
    fmt::print("{}", to_json(Value::object()
                                 .set("views", views.size())
                                 .set("parameters", parameters)
                                 .set("rms_px", s.rms_px)
                                 .set("method", s.method)));
    return;
  }
  fmt::print("{} views\n", views.size());
  for (const auto& l : s.lines) fmt::print("  {:<10}{:>14.7g}   u = {:.2g}\n", l.name, l.value, l.u);
  fmt::print("  residuals {:.4f} px rms per coordinate, {:.4f} px per point\n  {}\n", s.rms_px,
             s.rms_px * std::sqrt(2.0), s.method);
  if (o.cross_check) {
    print_cross_check(views, width, height, o.terms == DistortionTerms::automatic ? DistortionTerms::radial : o.terms,
                      *o.cross_check);
  }
}

}  // namespace fringecal::cli
