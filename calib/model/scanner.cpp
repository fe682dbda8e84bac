#include "calib/model/scanner.h"

#include "core/error.h"
#include "core/file.h"
#include "core/provenance_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::model {
namespace {

constexpr const char* kSchema = "fringecal.scanner";
constexpr int kVersion = 1;

Value to_value(const ParameterCovariance& u) {
  Value names = Value::array(), rows = Value::array(), standard = Value::object();
  for (std::size_t i = 0; i < u.names.size(); ++i) {
    names.append(u.names[i]);
    const auto row = u.covariance.row(static_cast<Eigen::Index>(i));
    rows.append(Value::numbers(std::vector<double>(row.begin(), row.end())));
    standard.set(u.names[i], std::sqrt(u.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i))));
  }
  return Value::object().set("standard_uncertainty", standard).set("names", names).set("covariance", rows);
}

ParameterCovariance covariance_from(Fields fields) {
  ParameterCovariance u;
  u.names = fields.texts("names");
  fields.ignore("standard_uncertainty");  // repeated for readers; the covariance is what counts
  const auto n = static_cast<Eigen::Index>(u.names.size());
  u.covariance.resize(n, n);
  const Value rows = fields.raw("covariance");
  const auto* array = rows.if_array();
  if (!array || array->size() != u.names.size()) fields.complain("'covariance' must have one row per name");
  for (Eigen::Index i = 0; i < n; ++i) {
    Fields row(Value::object().set("row", (*array)[static_cast<std::size_t>(i)]), fields.file(),
               "uncertainty.covariance");
    const auto numbers = row.numbers("row", u.names.size());
    for (Eigen::Index j = 0; j < n; ++j) u.covariance(i, j) = numbers[static_cast<std::size_t>(j)];
  }
  fields.finish();
  return u;
}

ResidualStatistics residuals_from(Fields f) {
  ResidualStatistics r;
  r.camera_rms_px = f.number("camera_rms_px");
  r.projector_rms = f.number("projector_rms");
  r.projector_unit = f.text("projector_unit");
  r.grid_rms_mm = f.number("grid_rms_mm");
  r.chi2_per_dof = f.number("chi2_per_dof");
  r.corners_used = f.integer("corners_used");
  r.corners_rejected = f.integer("corners_rejected");
  r.poses = f.integer("poses");
  r.iterations = f.integer("iterations");
  f.finish();
  return r;
}

// One line per corner: column, row, pixel x, pixel y, u(pixel), used (1 or 0), then value and u per coded axis.
Value to_value(const BoardObservation& o) {
  Value corners = Value::array();
  bool has_x = false, has_y = false;
  for (const auto& c : o.corners) {
    has_x = has_x || c.x;
    has_y = has_y || c.y;
  }
  for (const auto& c : o.corners) {
    Value line = Value::array();
    line.append(c.column)
        .append(c.row)
        .append(c.pixel.x())
        .append(c.pixel.y())
        .append(c.u_pixel_px)
        .append(c.used ? 1 : 0);
    for (const auto& [has, coordinate] : {std::pair(has_x, c.x), std::pair(has_y, c.y)}) {
      if (!has) continue;
      // u = 0 marks "no value at this corner": a measured coordinate never has it.
      line.append(coordinate ? coordinate->value : 0.0).append(coordinate ? coordinate->u : 0.0);
    }
    corners.append(line);
  }
  return Value::object().set("name", o.name).set("coded_x", has_x).set("coded_y", has_y).set("corners", corners);
}

BoardObservation observation_from(Fields f) {
  BoardObservation o;
  o.name = f.text("name");
  const bool has_x = f.boolean("coded_x"), has_y = f.boolean("coded_y");
  const Value lines = f.raw("corners");
  if (!lines.if_array()) f.complain("'corners' must be a list");
  for (const Value& line : *lines.if_array()) {
    Fields one(Value::object().set("corner", line), f.file(), "observations.corners");
    const auto n = one.numbers("corner", 6 + 2 * static_cast<std::size_t>(has_x) + 2 * static_cast<std::size_t>(has_y));
    CornerObservation c;
    c.column = static_cast<int>(n[0]);
    c.row = static_cast<int>(n[1]);
    c.pixel = {n[2], n[3]};
    c.u_pixel_px = n[4];
    c.used = n[5] != 0;
    if (has_x && n[7] > 0) c.x = Uncertain{n[6], n[7]};
    if (has_y && n[n.size() - 1] > 0) c.y = Uncertain{n[n.size() - 2], n[n.size() - 1]};
    o.corners.push_back(c);
  }
  f.finish();
  return o;
}

/// Where each named parameter lives. The rotation's three stand in `rotation`, as a rotation vector.
std::map<std::string, double*> parameter_places(Scanner& s, Eigen::Vector3d& rotation) {
  Eigen::Vector3d& translation = s.proj_from_cam.translation_mm;
  std::map<std::string, double*> places = {
      {"camera.fx_px", &s.camera.fx_px},
      {"camera.fy_px", &s.camera.fy_px},
      {"camera.cx_px", &s.camera.cx_px},
      {"camera.cy_px", &s.camera.cy_px},
      {"proj_from_cam.rotation_x_rad", &rotation.x()},
      {"proj_from_cam.rotation_y_rad", &rotation.y()},
      {"proj_from_cam.rotation_z_rad", &rotation.z()},
      {"proj_from_cam.translation_x_mm", &translation.x()},
      {"proj_from_cam.translation_y_mm", &translation.y()},
      {"proj_from_cam.translation_z_mm", &translation.z()},
  };
  static constexpr const char* kTerms[] = {"k1", "k2", "p1", "p2", "k3"};
  for (std::size_t k = 0; k < 5; ++k) {
    places[std::string("camera.") + kTerms[k]] = &s.camera.distortion[k];
    places[std::string("projector.") + kTerms[k]] = &s.projector.distortion[k];
  }
  if (s.projector.x) {
    places["projector.x.f"] = &s.projector.x->f;
    places["projector.x.u0"] = &s.projector.x->u0;
  }
  if (s.projector.y) {
    places["projector.y.f"] = &s.projector.y->f;
    places["projector.y.u0"] = &s.projector.y->u0;
  }
  return places;
}

}  // namespace

std::optional<double> ParameterCovariance::u(const std::string& name) const {
  const auto it = std::find(names.begin(), names.end(), name);
  if (it == names.end()) return std::nullopt;
  const auto i = static_cast<Eigen::Index>(it - names.begin());
  return std::sqrt(covariance(i, i));
}

double Scanner::value_of(const std::string& parameter) const {
  Scanner s = *this;
  Eigen::Vector3d rotation = vector_from_rotation(proj_from_cam.rotation);
  const auto places = parameter_places(s, rotation);
  const auto place = places.find(parameter);
  require(place != places.end(), "a parameter is asked for by a name of the model");
  return *place->second;
}

Scanner Scanner::changed_by(const Eigen::VectorXd& increments) const {
  require(increments.size() == static_cast<Eigen::Index>(uncertainty.names.size()), "one increment per parameter");
  Scanner s = *this;
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  const auto places = parameter_places(s, rotation);
  for (std::size_t i = 0; i < uncertainty.names.size(); ++i) {
    const auto place = places.find(uncertainty.names[i]);
    if (place == places.end()) {
      throw InputError(
          fmt::format("the Scanner's covariance names '{}', which is not a parameter of the model; calibrate again",
                      uncertainty.names[i]));
    }
    *place->second += increments(static_cast<Eigen::Index>(i));
  }
  s.proj_from_cam.rotation = (rotation_from_vector(rotation) * s.proj_from_cam.rotation).normalized();
  return s;
}

Eigen::Vector3d Scanner::corner_mm(int column, int row) const {
  require(board.has_value(), "corners are asked of a scanner that knows its board");
  if (board_corners_mm.empty()) return board->corner_mm(column, row);
  return board_corners_mm.at(static_cast<std::size_t>(row * board->columns + column));
}

Rigid3 Scanner::world_from_proj() const {
  // Rows: world X, Y, Z expressed in proj. Coded along x: X = x, Y = -y, Z = -z; along y: X = y, Y = x, Z = -z.
  Eigen::Matrix3d rotation;
  if (projector.main_axis() == CodeAxis::x) {
    rotation << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  } else {
    rotation << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  }
  return {Eigen::Quaterniond(rotation), Eigen::Vector3d(0, 0, working_distance_mm)};
}

Value to_value(const Rigid3& rigid) {
  const auto& q = rigid.rotation;
  return Value::object()
      .set("rotation_wxyz", Value::numbers(std::array{q.w(), q.x(), q.y(), q.z()}))
      .set("translation_mm", Value::numbers(rigid.translation_mm));
}

Rigid3 rigid_from(Fields fields) {
  const auto q = fields.numbers("rotation_wxyz", 4);
  const auto t = fields.numbers("translation_mm", 3);
  fields.finish();
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  if (!(std::abs(rotation.norm() - 1.0) < 1e-9)) fields.complain("rotation_wxyz must have length 1");
  return {rotation, Eigen::Vector3d(t[0], t[1], t[2])};
}

Value to_value(const ResidualStatistics& r) {
  return Value::object()
      .set("camera_rms_px", r.camera_rms_px)
      .set("projector_rms", r.projector_rms)
      .set("projector_unit", r.projector_unit)
      .set("grid_rms_mm", r.grid_rms_mm)
      .set("chi2_per_dof", r.chi2_per_dof)
      .set("corners_used", r.corners_used)
      .set("corners_rejected", r.corners_rejected)
      .set("poses", r.poses)
      .set("iterations", r.iterations);
}

void write_scanner(const std::filesystem::path& file, const Scanner& s) {
  Value priors = Value::array(), observations = Value::array(), poses = Value::array();
  for (const auto& p : s.priors) {
    priors.append(
        Value::object().set("parameter", p.parameter).set("value", p.value).set("u", p.u).set("reason", p.reason));
  }
  for (const auto& o : s.observations) observations.append(to_value(o));
  for (const auto& pose : s.cam_from_board) poses.append(to_value(pose));
  Value out = Value::object()
                  .set("schema", kSchema)
                  .set("schema_version", kVersion)
                  .set("name", s.name)
                  .set("camera", model::to_value(s.camera))
                  .set("projector", model::to_value(s.projector))
                  .set("proj_from_cam", to_value(s.proj_from_cam))
                  .set("working_distance_mm", s.working_distance_mm)
                  .set("method", s.method)
                  .set("residuals", to_value(s.residuals))
                  .set("priors", priors)
                  .set("uncertainty", to_value(s.uncertainty));
  if (s.board) out.set("board", model::to_value(*s.board));
  if (s.paper_model) out.set("paper_model", model::to_value(*s.paper_model));
  if (s.paper_ideal_model) out.set("paper_ideal_model", model::to_value(*s.paper_ideal_model));
  if (s.linearisation) out.set("phase_linearisation", model::to_value(*s.linearisation));
  if (!s.board_corners_mm.empty()) {
    Value corners = Value::array();
    for (const auto& corner : s.board_corners_mm) corners.append(Value::numbers(corner));
    out.set("board_corners_mm", corners);
  }
  if (!s.flats.empty()) {
    Value views = Value::array(), places = Value::array();
    for (const auto& flat : s.flats) views.append(to_value(flat));
    for (const auto& pose : s.cam_from_flat) places.append(to_value(pose));
    out.set("flat_witness",
            Value::object().set("u_flatness_mm", s.u_flatness_mm).set("cam_from_flat", places).set("views", views));
  }
  out.set("cam_from_board", poses)
      .set("observations", observations)
      .set("provenance", fringecal::to_value(s.provenance));
  write_atomically(file, to_json(out));
}

Scanner read_scanner(const std::filesystem::path& file) {
  Fields f(read_json(file), file.string());
  f.expect_schema(kSchema, kVersion);
  Scanner s;
  s.name = f.text("name");
  s.camera = camera_from(f.table("camera"));
  s.projector = projector_from(f.table("projector"));
  s.proj_from_cam = rigid_from(f.table("proj_from_cam"));
  s.working_distance_mm = f.number("working_distance_mm");
  s.method = f.text("method");
  s.residuals = residuals_from(f.table("residuals"));
  for (auto& p : f.tables("priors")) {
    s.priors.push_back({p.text("parameter"), p.number("value"), p.number("u"), p.text("reason")});
    p.finish();
  }
  s.uncertainty = covariance_from(f.table("uncertainty"));
  if (auto b = f.optional_table("board")) s.board = board_from(*b);
  if (const Value corners = f.raw("board_corners_mm"); corners.if_array()) {
    for (const Value& corner : *corners.if_array()) {
      Fields one(Value::object().set("corner", corner), f.file(), "board_corners_mm");
      const auto n = one.numbers("corner", 3);
      s.board_corners_mm.emplace_back(n[0], n[1], n[2]);
    }
    if (!s.board || s.board_corners_mm.size() != static_cast<std::size_t>(s.board->corners())) {
      f.complain("'board_corners_mm' must have one line per corner of 'board'");
    }
  }
  const CodeAxis axis = s.projector.main_axis();
  if (auto m = f.optional_table("paper_model")) s.paper_model = fitted_chen2008_from(*m, axis);
  if (auto m = f.optional_table("paper_ideal_model")) s.paper_ideal_model = fitted_chen2008_from(*m, axis);
  if (auto t = f.optional_table("phase_linearisation")) s.linearisation = phase_linearisation_from(*t);
  for (auto& pose : f.tables("cam_from_board")) s.cam_from_board.push_back(rigid_from(pose));
  for (auto& o : f.tables("observations")) s.observations.push_back(observation_from(o));
  if (auto flat = f.optional_table("flat_witness")) {
    s.u_flatness_mm = flat->number("u_flatness_mm");
    for (auto& pose : flat->tables("cam_from_flat")) s.cam_from_flat.push_back(rigid_from(pose));
    for (auto& o : flat->tables("views")) s.flats.push_back(observation_from(o));
    flat->finish();
    if (s.cam_from_flat.size() != s.flats.size()) flat->complain("'cam_from_flat' and 'views' must be as many");
  }
  s.provenance = provenance_from(f.table("provenance"));
  f.finish();
  if (s.cam_from_board.size() != s.observations.size())
    f.complain("'cam_from_board' and 'observations' must be as many");
  return s;
}

}  // namespace fringecal::model
