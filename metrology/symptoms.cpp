#include "metrology/symptoms.h"

#include "core/error.h"
#include "core/fields.h"
#include "core/statistics.h"
#include "fitting/fit.h"
#include "metrology/acceptance.h"
#include "metrology/artefact.h"
#include "metrology/calibration_uncertainty.h"

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace fringecal::metrology {
namespace {

constexpr const char* kSchema = "fringecal.baseline";

// Scatter of a healthy scanner that is not the noise of its fits (standard uncertainties).
constexpr double kFloorDistance_mm = 0.003, kFloorDiameter_mm = 0.004, kFloorBend_mm = 0.002;
constexpr double kFloorModulation = 0.05, kFloorScatter = 0.05;  // ln: lamp, exposure, place of the plate
constexpr double kRoomSd_K = 1.5, kSensor_K = 0.5;
constexpr double kFrameExpansion_per_K = 17e-6, kUFrameExpansion_per_K = 6e-6;
constexpr std::size_t kThinned = 2000;  // points per body for the derivatives: the effects are smooth over a body

/// A part of an artefact: a sphere, a cylinder, a flat.
struct Body {
  ArtefactKind kind = ArtefactKind::sphere;
  std::vector<Eigen::Vector3d> points;
};

struct Bends {
  Eigen::Vector3d value, u;  // eq. 1: u^2, v^2, u v; u from the scatter
  double scatter = 0;
};

/// Eq. 1.
Result<Bends> bends_of(const std::vector<Eigen::Vector3d>& points) {
  const auto plane = fitting::fit_plane(points);
  if (!plane) return tl::unexpected(plane.error());
  const Eigen::Vector3d normal = plane->normal.z() < 0 ? Eigen::Vector3d(-plane->normal) : plane->normal;
  const Eigen::Vector3d along_y = normal.cross(Eigen::Vector3d::UnitX()).normalized(), along_x = along_y.cross(normal);
  double half_x = 0, half_y = 0;
  for (const auto& p : points) {
    half_x = std::max(half_x, std::abs((p - plane->point_mm).dot(along_x)));
    half_y = std::max(half_y, std::abs((p - plane->point_mm).dot(along_y)));
  }
  Eigen::Matrix<double, 6, 6> A = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
  double squares = 0;
  for (const auto& p : points) {
    const Eigen::Vector3d d = p - plane->point_mm;
    const double u = d.dot(along_x) / half_x, v = d.dot(along_y) / half_y, z = d.dot(normal);
    const Eigen::Matrix<double, 6, 1> row{u * u, v * v, u * v, u, v, 1};
    A += row * row.transpose();
    b += row * z;
    squares += z * z;
  }
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(A);
  const Eigen::Matrix<double, 6, 1> x = solver.solve(b);
  const double left = std::max(squares - x.dot(b), 0.0) / static_cast<double>(points.size() - 6);
  const Eigen::Matrix<double, 6, 6> covariance = left * solver.solve(Eigen::Matrix<double, 6, 6>::Identity());
  return Bends{x.head<3>(), covariance.diagonal().head<3>().cwiseSqrt(), std::sqrt(left)};
}

struct Shape {
  Eigen::Vector3d place = Eigen::Vector3d::Zero(), u_place = Eigen::Vector3d::Zero();
  double diameter = 0, u_diameter = 0;
};

Result<Shape> shape_of(const Body& body) {
  if (body.kind == ArtefactKind::sphere) {
    const auto fit = fitting::fit_sphere(body.points);
    if (!fit) return tl::unexpected(fit.error());
    return Shape{fit->center_mm, fit->u_center_mm, fit->diameter_mm, fit->u_diameter_mm};
  }
  const auto fit = fitting::fit_cylinder(body.points);
  if (!fit) return tl::unexpected(fit.error());
  return Shape{fit->axis_point_mm, Eigen::Vector3d::Zero(), fit->diameter_mm, fit->u_diameter_mm};
}

/// One element of the geometric symptoms.
struct Element {
  std::string name, artefact;
  double certified = 0;  // 0: a bend
  double u_certificate = 0, expansion_per_K = 0, reference_degC = 20, floor = 0;
};

std::vector<Element> elements_of(const std::vector<Gauge>& gauges) {
  std::vector<Element> out;
  for (const auto& g : gauges) {
    const auto length = [&](const std::string& what, double certified, double U, double floor) {
      out.push_back({fmt::format("{}, {} / mm", g.name, what), g.name, certified, U / g.k, g.expansion_per_K,
                     g.reference_temperature_degC, floor});
    };
    if (g.kind == GaugeKind::flat) {
      for (const char* what : {"bend along X", "bend along Y", "twist"}) {
        out.push_back({fmt::format("{}, {} / mm", g.name, what), g.name, 0, 0.5 * (g.form_mm + g.U_form_mm), 0, 20,
                       kFloorBend_mm});
      }
      continue;
    }
    if (g.distance_mm) length("distance", *g.distance_mm, g.U_distance_mm, kFloorDistance_mm);
    for (std::size_t k = 0; k < g.diameter_mm.size(); ++k) {
      length(g.diameter_mm.size() == 1 ? "diameter" : fmt::format("diameter {}", k == 0 ? "A" : "B"), g.diameter_mm[k],
             g.U_diameter_mm, kFloorDiameter_mm);
    }
  }
  return out;
}

struct Figures {
  Eigen::VectorXd value, u;  // of the elements; u: noise of the fits
  double scatter = 0;        // of the flat, 0 without one
};

/// bodies: in the order of the gauges, a ball bar's two one after the other.
Result<Figures> figures_of(const std::vector<Body>& bodies, const std::vector<Gauge>& gauges) {
  std::vector<double> value, u;
  Figures out;
  std::size_t at = 0;
  const auto add = [&](double v, double standard) {
    value.push_back(v);
    u.push_back(standard);
  };
  for (const auto& g : gauges) {
    if (g.kind == GaugeKind::flat) {
      const auto bends = bends_of(bodies[at++].points);
      if (!bends) return tl::unexpected(bends.error());
      for (int k = 0; k < 3; ++k) add(bends->value(k), bends->u(k));
      out.scatter = bends->scatter;
      continue;
    }
    std::vector<Shape> shapes;
    for (std::size_t k = 0; k < g.diameter_mm.size(); ++k) {
      const auto shape = shape_of(bodies[at++]);
      if (!shape) return unanswerable(fmt::format("{}: {}", g.name, shape.error().sentence));
      shapes.push_back(*shape);
    }
    if (g.distance_mm) {
      const Eigen::Vector3d between = shapes[1].place - shapes[0].place, along = between.normalized();
      add(between.norm(),
          std::hypot(shapes[0].u_place.cwiseProduct(along).norm(), shapes[1].u_place.cwiseProduct(along).norm()));
    }
    for (const auto& shape : shapes) add(shape.diameter, shape.u_diameter);
  }
  out.value = Eigen::Map<Eigen::VectorXd>(value.data(), static_cast<Eigen::Index>(value.size()));
  out.u = Eigen::Map<Eigen::VectorXd>(u.data(), static_cast<Eigen::Index>(u.size()));
  return out;
}

Result<std::vector<Body>> bodies_of(const Observation& o) {
  std::vector<NominalArtefact> nominals;
  for (const auto& gauge : o.gauges) {
    if (gauge.kind == GaugeKind::step || gauge.kind == GaugeKind::sphere_plate) {
      return unanswerable(
          fmt::format("{}: a diagnosis is made from spheres, ball bars, cylinders and flats, not from a {}", gauge.name,
                      name_of(gauge.kind)));
    }
  }
  for (const auto& gauge : o.gauges) {
    for (const auto& nominal : nominals_of(gauge)) nominals.push_back(nominal);
  }
  const auto found = measure_artefacts(o.cloud, o.scanner, nominals);
  if (!found) return tl::unexpected(found.error());
  std::vector<Body> out;
  out.reserve(found->size());
  for (const auto& m : *found) out.push_back({m.kind, m.points_mm});
  return out;
}

std::vector<Body> thinned(const std::vector<Body>& bodies) {
  std::vector<Body> out;
  out.reserve(bodies.size());
  for (const auto& body : bodies) out.push_back({body.kind, metrology::thinned(body.points, kThinned)});
  return out;
}

/// The figures that `reader` reads from what `seen_by` saw, the bodies being where they are.
Result<Eigen::VectorXd> read_through(const std::vector<Body>& bodies, const std::vector<Gauge>& gauges,
                                     const model::Scanner& seen_by, const model::Scanner& reader) {
  std::vector<Body> moved;
  moved.reserve(bodies.size());
  for (const auto& body : bodies) moved.push_back({body.kind, retriangulate(body.points, seen_by, reader)});
  const auto figures = figures_of(moved, gauges);
  if (!figures) return tl::unexpected(figures.error());
  return figures->value;
}

double median_modulation(const PointCloud& cloud) {
  std::vector<double> values;
  for (const auto& p : cloud.points) values.push_back(p.modulation);
  return median(std::move(values));
}

/// Everything that depends on derivatives: eq. 2's effects and the calibration's covariance, of the geometric elements.
struct Derivatives {
  Eigen::VectorXd base_per_mm;
  Eigen::MatrixXd camera_per_mrad;  // three columns
  Eigen::MatrixXd calibration;      // covariance
};

Result<Derivatives> derivatives_of(const std::vector<Body>& bodies, const Observation& o) {
  const auto n = static_cast<Eigen::Index>(elements_of(o.gauges).size());
  Derivatives out{Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Zero(n, 3), Eigen::MatrixXd::Zero(n, n)};
  const auto difference = [&](const auto& pair, double step) -> Result<Eigen::VectorXd> {
    Eigen::VectorXd side[2];
    for (const int k : {0, 1}) {
      const auto [seen_by, reader] = pair(k == 0 ? -step : step);
      const auto value = read_through(bodies, o.gauges, seen_by, reader);
      if (!value) return tl::unexpected(value.error());
      side[k] = *value;
    }
    return Eigen::VectorXd((side[1] - side[0]) / (2 * step));
  };
  const auto base = difference(
      [&](double mm) {
        model::Scanner faulty = o.scanner;
        faulty.proj_from_cam.translation_mm *= 1 + mm / o.scanner.base_mm();
        return std::pair(faulty, o.scanner);
      },
      0.05);
  if (!base) return tl::unexpected(base.error());
  out.base_per_mm = *base;
  for (int axis = 0; axis < 3; ++axis) {
    const auto turned = difference(
        [&](double mrad) {
          model::Scanner faulty = o.scanner;
          const Rigid3 turn{rotation_from_vector(1e-3 * mrad * Eigen::Vector3d::Unit(axis)), Eigen::Vector3d::Zero()};
          faulty.proj_from_cam = o.scanner.proj_from_cam * turn;
          return std::pair(faulty, o.scanner);
        },
        0.1);
    if (!turned) return tl::unexpected(turned.error());
    out.camera_per_mrad.col(axis) = *turned;
  }
  const auto& uncertainty = o.scanner.uncertainty;
  const auto parameters = static_cast<Eigen::Index>(uncertainty.names.size());
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(n, parameters);
  for (Eigen::Index i = 0; i < parameters; ++i) {
    const double step = std::sqrt(uncertainty.covariance(i, i));
    if (!(step > 0)) continue;
    const auto column = difference(
        [&](double change) {
          const Eigen::VectorXd increments = change * Eigen::VectorXd::Unit(parameters, i);
          return std::pair(o.scanner, o.scanner.changed_by(increments));
        },
        step);
    if (!column) return tl::unexpected(column.error());
    G.col(i) = *column;
  }
  if (parameters > 0) out.calibration = G * uncertainty.covariance * G.transpose();
  return out;
}

/// Symptoms that are not geometry, in rows after it.
struct MoreRows {
  std::vector<std::string> names;
  std::vector<double> residuals, variances;
  std::optional<Eigen::Index> modulation, scatter, room;
};

MoreRows more_rows(const Observation& o, const std::optional<Baseline>& baseline, double scatter, double T_0,
                   Eigen::Index first, std::vector<std::string>& remarks) {
  MoreRows out;
  const auto add = [&](const char* name, double residual, double u) {
    out.names.emplace_back(name);
    out.residuals.push_back(residual);
    out.variances.push_back(u * u);
    return first + static_cast<Eigen::Index>(out.names.size()) - 1;
  };
  if (baseline) {
    out.modulation = add("modulation, ln of its ratio to the baseline",
                         std::log(median_modulation(o.cloud) / baseline->modulation), kFloorModulation);
    if (scatter > 0 && baseline->scatter_mm > 0) {
      out.scatter =
          add("scatter, ln of its ratio to the baseline", std::log(scatter / baseline->scatter_mm), kFloorScatter);
    }
  } else {
    remarks.emplace_back("there is no baseline: a projector that grows dirty is not seen");
  }
  if (o.room_degC) {
    out.room = add("room / K", *o.room_degC - T_0, kSensor_K);
  } else {
    remarks.emplace_back("no temperature was read: a warm room and a changed base line cannot be told apart");
  }
  return out;
}

}  // namespace

Value to_value(const Baseline& b) {
  Value out = Value::object()
                  .set("schema", kSchema)
                  .set("schema_version", 1)
                  .set("date", b.date)
                  .set("scanner_file_sha256", b.scanner_file_sha256)
                  .set("modulation", b.modulation)
                  .set("scatter_mm", b.scatter_mm);
  if (b.temperature_degC) out.set("temperature_degC", *b.temperature_degC);
  return out;
}

Baseline read_baseline(const std::filesystem::path& file) {
  Fields fields(read_json(file), file.string());
  fields.expect_schema(kSchema, 1);
  Baseline b;
  b.date = fields.text("date");
  b.scanner_file_sha256 = fields.text("scanner_file_sha256");
  b.modulation = fields.number("modulation");
  b.scatter_mm = fields.number("scatter_mm");
  b.temperature_degC = fields.optional_number("temperature_degC");
  if (!(b.modulation > 0) || !(b.scatter_mm > 0)) fields.complain("modulation and scatter_mm are above zero");
  fields.finish();
  return b;
}

Result<Baseline> baseline_of(const Observation& o) {
  const auto bodies = bodies_of(o);
  if (!bodies) return tl::unexpected(bodies.error());
  const auto figures = figures_of(*bodies, o.gauges);
  if (!figures) return tl::unexpected(figures.error());
  if (!(figures->scatter > 0)) return unanswerable("a baseline needs a flat in the capture");
  return Baseline{.modulation = median_modulation(o.cloud),
                  .scatter_mm = figures->scatter,
                  .temperature_degC = o.room_degC,
                  .date = {},
                  .scanner_file_sha256 = {}};
}

Result<Symptoms> symptoms_of(const Observation& o, const std::optional<Baseline>& baseline) {
  const auto bodies = bodies_of(o);
  if (!bodies) return tl::unexpected(bodies.error());
  const auto figures = figures_of(*bodies, o.gauges);
  if (!figures) return tl::unexpected(figures.error());
  const auto derivatives = derivatives_of(thinned(*bodies), o);
  if (!derivatives) return tl::unexpected(derivatives.error());
  const auto elements = elements_of(o.gauges);
  const double T_0 = baseline ? baseline->temperature_degC.value_or(20) : 20;
  const auto geometric = static_cast<Eigen::Index>(elements.size());

  Symptoms s;
  const MoreRows more = more_rows(o, baseline, figures->scatter, T_0, geometric, s.remarks);
  const Eigen::Index n = geometric + static_cast<Eigen::Index>(more.names.size());
  s.residual = Eigen::VectorXd::Zero(n);
  s.covariance = Eigen::MatrixXd::Zero(n, n);
  s.covariance.topLeftCorner(geometric, geometric) = derivatives->calibration;
  Eigen::VectorXd frame = Eigen::VectorXd::Zero(n), room = Eigen::VectorXd::Zero(n);  // per kelvin
  frame.head(geometric) = kFrameExpansion_per_K * o.scanner.base_mm() * derivatives->base_per_mm;
  room = frame;
  for (Eigen::Index i = 0; i < geometric; ++i) {
    const Element& e = elements[static_cast<std::size_t>(i)];
    const double expected = e.certified * (1 + e.expansion_per_K * (T_0 - e.reference_degC));
    s.names.push_back(e.name);
    s.residual(i) = figures->value(i) - expected;
    s.covariance(i, i) += figures->u(i) * figures->u(i) + e.u_certificate * e.u_certificate + e.floor * e.floor;
    room(i) += e.certified * e.expansion_per_K;
    const double percent = e.certified > 0 ? 100 * std::abs(s.residual(i)) / e.certified : 0;
    if (percent > s.trueness_percent) {
      s.trueness_percent = percent;
      s.worst_length = e.name;
    }
  }
  for (std::size_t k = 0; k < more.names.size(); ++k) {
    const Eigen::Index i = geometric + static_cast<Eigen::Index>(k);
    s.names.push_back(more.names[k]);
    s.residual(i) = more.residuals[k];
    s.covariance(i, i) = more.variances[k];
  }
  if (more.room) room(*more.room) = 1;
  s.covariance += kRoomSd_K * kRoomSd_K * room * room.transpose();
  if (o.room_degC) {  // what is not known of the frame's expansion, at the temperature that was read
    const double relative = kUFrameExpansion_per_K / kFrameExpansion_per_K * (*o.room_degC - T_0);
    s.covariance += relative * relative * frame * frame.transpose();
  }

  const auto column = [&](const Eigen::MatrixXd& geometry) {
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(n, geometry.cols());
    out.topRows(geometric) = geometry;
    return out;
  };
  Eigen::MatrixXd dirty = Eigen::MatrixXd::Zero(n, 1);
  if (more.modulation) dirty(*more.modulation, 0) = 1;
  if (more.scatter) dirty(*more.scatter, 0) = -1;
  // Faults are rare; none of the causes is more common than another as far as anybody has counted.
  constexpr double kPriorFault = 0.02;
  s.hypotheses.push_back({"healthy", 0.9, {}, Eigen::MatrixXd(n, 0)});
  s.hypotheses.push_back(
      {"base line changed", kPriorFault, {{"base line", "mm", 0.2}}, column(derivatives->base_per_mm)});
  s.hypotheses.push_back({"camera knocked",
                          kPriorFault,
                          {{"about its x", "mrad", 0.5}, {"about its y", "mrad", 0.5}, {"about its axis", "mrad", 0.5}},
                          column(derivatives->camera_per_mrad)});
  s.hypotheses.push_back({"dirty projector", kPriorFault, {{"ln of the modulation", "", 0.5}}, dirty});
  s.hypotheses.push_back({"warm room", kPriorFault, {{"warmer by", "K", 8}}, room});
  std::vector<std::string> artefacts;
  for (const auto& e : elements) {
    if (e.certified > 0 && (artefacts.empty() || artefacts.back() != e.artefact)) artefacts.push_back(e.artefact);
  }
  for (const auto& artefact : artefacts) {
    Hypothesis wrong{fmt::format("certificate of {} wrong", artefact),
                     kPriorFault / static_cast<double>(artefacts.size()),
                     {},
                     Eigen::MatrixXd::Zero(n, 0)};
    for (std::size_t i = 0; i < elements.size(); ++i) {
      if (elements[i].artefact != artefact || !(elements[i].certified > 0)) continue;
      wrong.amplitudes.push_back({elements[i].name.substr(artefact.size() + 2), "", 0.1});
      wrong.effect.conservativeResize(n, wrong.effect.cols() + 1);
      wrong.effect.col(wrong.effect.cols() - 1) = Eigen::VectorXd::Unit(n, static_cast<Eigen::Index>(i));
    }
    s.hypotheses.push_back(std::move(wrong));
  }
  return s;
}

}  // namespace fringecal::metrology
