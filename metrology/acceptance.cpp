#include "metrology/acceptance.h"

#include "core/error.h"
#include "fitting/fit.h"
#include "metrology/artefact.h"
#include "metrology/calibration_uncertainty.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::metrology {
namespace {

// Digits of u that the Monte Carlo validates: with 2e5 trials an end of the interval is known to 0.006 u, below a fifth of
// the tolerance of one digit (0.05 u at least), as [JCGM101, 8.2] wants it, but not of two.
constexpr int kValidationDigits = 1;
constexpr std::size_t kThinned = 2000;  // points that carry the calibration's uncertainty: it is smooth over a feature

struct FormFigures {
  double range = 0, shell_95 = 0;
};

/// Eqs. 1 and 2 over the points kept.
FormFigures form_of(const fitting::FitQuality& quality) {
  std::vector<double> kept;
  for (std::size_t i = 0; i < quality.distances_mm.size(); ++i) {
    if (!quality.rejected[i]) kept.push_back(quality.distances_mm[i]);
  }
  std::sort(kept.begin(), kept.end());
  const auto at = [&](double p) {
    return kept[static_cast<std::size_t>(p * static_cast<double>(kept.size() - 1) + 0.5)];
  };
  return {kept.back() - kept.front(), at(0.975) - at(0.025)};
}

struct Described {
  FeatureResult feature;
  Eigen::Vector3d u_centre_mm = Eigen::Vector3d::Zero();  // of a sphere
};

Result<Described> describe(const ArtefactMeasurement& m, fitting::Rejection rejection) {
  Described described{.feature = {.artefact = m.name}};
  FeatureResult& out = described.feature;
  const fitting::FitOptions options{.rejection = rejection};
  const auto keep = [&](const fitting::FitQuality& quality) {
    const FormFigures form = form_of(quality);
    out.range_mm = form.range;
    out.shell_95_mm = form.shell_95;
    out.sd_mm = quality.standard_deviation_mm;  // eq. 3
    out.n_points = static_cast<int>(quality.n_used);
    out.n_rejected = static_cast<int>(m.n_gross + quality.n_rejected);
    out.residuals = residual_cloud(m.points_mm, quality.distances_mm, quality.rejected);
  };
  if (m.kind == ArtefactKind::plane) {
    const auto fit = fitting::fit_plane(m.points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    keep(fit->quality);
    out.place_mm = fit->point_mm;
  } else if (m.kind == ArtefactKind::sphere) {
    const auto fit = fitting::fit_sphere(m.points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    keep(fit->quality);
    out.place_mm = fit->center_mm;
    described.u_centre_mm = fit->u_center_mm;
    out.diameter_mm = fit->diameter_mm;
    out.u_noise_mm = fit->u_diameter_mm;
  } else {
    const auto fit = fitting::fit_cylinder(m.points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    keep(fit->quality);
    out.place_mm = fit->axis_point_mm;
    out.diameter_mm = fit->diameter_mm;
    out.u_noise_mm = fit->u_diameter_mm;
  }
  return described;
}

/// The distance of two spheres' centres, with what the calibration's uncertainty makes of it.
Result<DistanceResult> distance_of(const ArtefactMeasurement& a, const ArtefactMeasurement& b, const Described& da,
                                   const Described& db, const model::Scanner& scanner) {
  const FeatureResult &fa = da.feature, &fb = db.feature;
  auto points = thinned(a.points_mm, kThinned);
  const auto second = thinned(b.points_mm, kThinned);
  points.insert(points.end(), second.begin(), second.end());
  const auto distance = [&](std::span<const Eigen::Vector3d> moved) -> Result<double> {
    // retriangulate() may leave points out, so they are told apart by the nearer centre.
    std::vector<Eigen::Vector3d> near_a, near_b;
    for (const auto& p : moved) {
      ((p - fa.place_mm).squaredNorm() < (p - fb.place_mm).squaredNorm() ? near_a : near_b).push_back(p);
    }
    const auto fit_a = fitting::fit_sphere(near_a), fit_b = fitting::fit_sphere(near_b);
    if (!fit_a) return tl::unexpected(fit_a.error());
    if (!fit_b) return tl::unexpected(fit_b.error());
    return (fit_a->center_mm - fit_b->center_mm).norm();
  };
  const auto u = u_from_calibration(points, scanner, distance);
  if (!u) return tl::unexpected(u.error());
  const Eigen::Vector3d between = (fb.place_mm - fa.place_mm).normalized();
  const double u_noise =
      std::hypot(da.u_centre_mm.cwiseProduct(between).norm(), db.u_centre_mm.cwiseProduct(between).norm());
  return DistanceResult{a.name, (fa.place_mm - fb.place_mm).norm(), u_noise, *u};
}

// ---- from results to quantities

struct Reading {
  int capture = 0;
  double value = 0, u_noise = 0, u_calibration = 0;
  int n_points = 0, n_rejected = 0;
};

/// E = x - l (1 + alpha (t - t_ref)) with x fixed, or a mean with Student's t.
Validation validate_length(const Gauge& g, double length, double U_certificate, double x, double s_of_mean, double nu,
                           const EvaluateOptions& options, double error, const Combined& combined) {
  const Environment& e = options.environment;
  const double half_width = e.u_temperature_degC * std::sqrt(3.0);
  const std::vector<RandomInput> inputs = {
      {.mean = x, .form = Form::student_t, .scale = s_of_mean, .nu = nu},
      {.mean = length, .scale = U_certificate / g.k},
      {.mean = g.expansion_per_K, .scale = g.u_expansion_per_K},
      {.mean = e.temperature_degC - g.reference_temperature_degC, .form = Form::rectangular, .scale = half_width}};
  const auto result = propagate([](std::span<const double> v) { return v[0] - v[1] * (1 + v[2] * v[3]); }, inputs,
                                {.coverage = combined.coverage, .max_trials = options.monte_carlo_trials});
  return validate(error, combined.u, combined.U, result, kValidationDigits);
}

struct Length {
  double certified = 0, U = 0;
};

Quantity base(const PlannedQuantity& planned, const Gauge& gauge, const std::string& position) {
  return {.symbol = planned.symbol,
          .name = planned.name,
          .artefact = gauge.name,
          .position = position,
          .limits = planned.limits};
}

void finish(Quantity& q, DecisionRule rule) {
  q.uncertainty = combine(q.budget);
  if (q.limits) q.judgement = judge(q.value, q.uncertainty, *q.limits, rule);
}

Quantity length_quantity(const Plan& plan, const PlannedQuantity& planned, const Gauge& gauge, const Length& length,
                         std::span<const Reading> readings, const std::string& position,
                         const EvaluateOptions& options) {
  const Environment& e = options.environment;
  Quantity q = base(planned, gauge, position);
  const auto n = static_cast<double>(readings.size());
  double mean = 0, squares = 0, noise = 0, calibration = 0;
  for (const auto& r : readings) {
    mean += r.value / n;
    noise = std::max(noise, r.u_noise);
    calibration = std::max(calibration, r.u_calibration);
    q.n_points += r.n_points;
    q.n_rejected += r.n_rejected;
  }
  for (const auto& r : readings) squares += (r.value - mean) * (r.value - mean);
  q.value = mean - length_at(gauge, length.certified, e);
  q.budget = contributions_of(gauge, length.certified, length.U, e);
  double u_reference = 0;
  for (const auto& c : q.budget) u_reference = std::hypot(u_reference, c.u_of_quantity());
  double s = noise, s_of_mean = 0, nu = kInfiniteNu;
  if (readings.size() > 1) {
    s = std::sqrt(squares / (n - 1));
    s_of_mean = s / std::sqrt(n);
    nu = n - 1;
    q.budget.push_back({.name = "repeatability of the mean",  // eq. 4
                        .evaluation = Evaluation::type_a,
                        .form = Form::student_t,
                        .u = s_of_mean,
                        .nu = nu});
  }
  finish(q, plan.decision_rule);
  if (options.monte_carlo_trials > 0) {
    q.validation =
        validate_length(gauge, length.certified, length.U, mean, s_of_mean, nu, options, q.value, q.uncertainty);
  }
  q.u_of_later_measurements = std::sqrt(u_reference * u_reference + s * s + calibration * calibration);  // eq. 6
  return q;
}

Quantity form_quantity(const Plan& plan, const PlannedQuantity& planned, const Gauge& gauge, double value,
                       const FeatureResult& feature, const std::string& position) {
  Quantity q = base(planned, gauge, position);
  q.value = value;
  q.n_points = feature.n_points;
  q.n_rejected = feature.n_rejected;
  q.budget = {{.name = "form of the artefact", .form = Form::normal, .u = gauge.form_mm / 2},  // eq. 5
              {.name = "certificate of its form", .u = gauge.U_form_mm / gauge.k}};
  finish(q, plan.decision_rule);
  return q;
}

/// Features of one part of one gauge, by capture.
std::vector<std::pair<int, const FeatureResult*>> features_of(const std::vector<CaptureResult>& results,
                                                              const std::string& gauge, int part) {
  std::vector<std::pair<int, const FeatureResult*>> out;
  for (const auto& r : results) {
    for (const auto& f : r.features) {
      if (f.artefact == gauge && f.part == part) out.emplace_back(r.capture, &f);
    }
  }
  std::sort(out.begin(), out.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return out;
}

std::string part_name(const Gauge& gauge, int part) {
  return gauge.diameter_mm.size() > 1 ? fmt::format(", sphere {}", part == 0 ? "A" : "B") : "";
}

void add_diameters(std::vector<Quantity>& out, const Plan& plan, const PlannedQuantity& planned, const Gauge& gauge,
                   const std::vector<CaptureResult>& results, const EvaluateOptions& options) {
  for (int part = 0; part < static_cast<int>(gauge.diameter_mm.size()); ++part) {
    std::vector<Reading> readings;
    for (const auto& [capture, f] : features_of(results, gauge.name, part)) {
      readings.push_back({capture, *f->diameter_mm, f->u_noise_mm.value_or(0), f->u_calibration_mm.value_or(0),
                          f->n_points, f->n_rejected});
    }
    const Length length{gauge.diameter_mm[static_cast<std::size_t>(part)], gauge.U_diameter_mm};
    if (planned.measurand == Measurand::mean_diameter_error) {
      out.push_back(length_quantity(plan, planned, gauge, length, readings,
                                    fmt::format("mean of {}{}", readings.size(), part_name(gauge, part)), options));
      continue;
    }
    for (const auto& r : readings) {
      out.push_back(length_quantity(plan, planned, gauge, length, std::span(&r, 1),
                                    fmt::format("{}{}", r.capture + 1, part_name(gauge, part)), options));
    }
  }
}

void add_distances(std::vector<Quantity>& out, const Plan& plan, const PlannedQuantity& planned, const Gauge& gauge,
                   std::vector<CaptureResult> results, const EvaluateOptions& options) {
  std::sort(results.begin(), results.end(), [](const auto& a, const auto& b) { return a.capture < b.capture; });
  for (const auto& r : results) {
    for (const auto& d : r.distances) {
      if (d.artefact != gauge.name) continue;
      Reading reading{r.capture, d.distance_mm, d.u_noise_mm, d.u_calibration_mm};
      for (const auto& f : r.features) {
        reading.n_points += f.n_points;
        reading.n_rejected += f.n_rejected;
      }
      out.push_back(length_quantity(plan, planned, gauge, {*gauge.distance_mm, gauge.U_distance_mm},
                                    std::span(&reading, 1), std::to_string(r.capture + 1), options));
    }
  }
}

void add_forms(std::vector<Quantity>& out, const Plan& plan, const PlannedQuantity& planned, const Gauge& gauge,
               const std::vector<CaptureResult>& results) {
  const int parts = std::max<int>(1, static_cast<int>(gauge.diameter_mm.size()));
  for (int part = 0; part < parts; ++part) {
    const auto features = features_of(results, gauge.name, part);
    const FeatureResult* largest = nullptr;
    for (const auto& [capture, f] : features) {
      if (planned.measurand == Measurand::form_sd) {
        if (largest == nullptr || f->sd_mm > largest->sd_mm) largest = f;
        continue;
      }
      const double value = planned.measurand == Measurand::form_range ? f->range_mm : f->shell_95_mm;
      out.push_back(
          form_quantity(plan, planned, gauge, value, *f, fmt::format("{}{}", capture + 1, part_name(gauge, part))));
    }
    if (largest != nullptr) {
      out.push_back(form_quantity(plan, planned, gauge, largest->sd_mm, *largest,
                                  fmt::format("largest of {}{}", features.size(), part_name(gauge, part))));
    }
  }
}

}  // namespace

std::vector<NominalArtefact> nominals_of(const Gauge& gauge) {
  if (gauge.kind == GaugeKind::flat) return {{gauge.name, ArtefactKind::plane, 0}};
  std::vector<NominalArtefact> out;
  for (const double d : gauge.diameter_mm)
    out.push_back({gauge.name, gauge.kind == GaugeKind::cylinder ? ArtefactKind::cylinder : ArtefactKind::sphere, d});
  return out;
}

Result<CaptureResult> evaluate_capture(const Plan& plan, const Series& series, int capture,
                                       const std::vector<Gauge>& gauges, const PointCloud& cloud,
                                       const model::Scanner& scanner) {
  std::vector<NominalArtefact> nominals;
  for (const auto& name : series.artefacts) {
    for (const auto& nominal : nominals_of(gauge_named(gauges, name))) nominals.push_back(nominal);
  }
  const auto found = measure_artefacts(cloud, scanner, nominals);
  if (!found) return tl::unexpected(found.error());
  CaptureResult out{.capture = capture};
  std::vector<Described> described;
  for (const auto& m : *found) {
    auto one = describe(m, plan.rejection);
    if (!one) return unanswerable(fmt::format("{}: {}", m.name, one.error().sentence));
    FeatureResult& feature = one->feature;
    if (!out.features.empty() && out.features.back().artefact == m.name) feature.part = out.features.back().part + 1;
    if (m.diameter_mm) {
      const auto u = u_diameter_from_calibration(m, scanner);
      if (!u) return unanswerable(fmt::format("{}: {}", m.name, u.error().sentence));
      feature.u_calibration_mm = *u;
    }
    out.features.push_back(feature);
    described.push_back(*std::move(one));
  }
  for (std::size_t i = 1; i < found->size(); ++i) {
    if (out.features[i].part != 1) continue;
    const auto distance = distance_of((*found)[i - 1], (*found)[i], described[i - 1], described[i], scanner);
    if (!distance) return tl::unexpected(distance.error());
    out.distances.push_back(*distance);
  }
  return out;
}

std::vector<Quantity> evaluate_series(const Plan& plan, const Series& series, const std::vector<Gauge>& gauges,
                                      const std::vector<CaptureResult>& results, const EvaluateOptions& options) {
  require(!results.empty(), "a series is evaluated from at least one capture");
  std::vector<Quantity> out;
  for (const auto& planned : series.quantities) {
    for (const auto& name : series.artefacts) {
      const Gauge& gauge = gauge_named(gauges, name);
      switch (planned.measurand) {
        case Measurand::diameter_error:
        case Measurand::mean_diameter_error:
          add_diameters(out, plan, planned, gauge, results, options);
          break;
        case Measurand::distance_error:
          add_distances(out, plan, planned, gauge, results, options);
          break;
        case Measurand::form_range:
        case Measurand::form_95:
        case Measurand::form_sd:
          add_forms(out, plan, planned, gauge, results);
          break;
      }
    }
  }
  return out;
}

std::vector<GaugeSummary> summaries_of(const Series& series, const std::vector<Gauge>& gauges,
                                       const std::vector<CaptureResult>& results, const Environment& environment) {
  std::vector<GaugeSummary> out;
  const auto add = [&](const std::string& symbol, const Gauge& gauge, const std::vector<double>& errors, double noise) {
    if (errors.size() < 2) return;
    const auto n = static_cast<double>(errors.size());
    GaugeSummary s{symbol, gauge.name, static_cast<int>(errors.size()), series.repeats};
    double squares = 0;
    for (const double e : errors) s.mean_mm += e / n;
    for (const double e : errors) squares += (e - s.mean_mm) * (e - s.mean_mm);
    const double variance = squares / (n - 1);
    s.repeatability_mm = series.repeats ? std::sqrt(variance) : noise;                               // eq. 1
    if (!series.repeats) s.reproducibility_mm = std::sqrt(std::max(0.0, variance - noise * noise));  // eq. 2
    out.push_back(s);
  };
  for (const auto& planned : series.quantities) {
    for (const auto& name : series.artefacts) {
      const Gauge& gauge = gauge_named(gauges, name);
      std::vector<double> errors;
      double squares = 0;
      const auto take = [&](double measured, double certified, double u_noise) {
        errors.push_back(measured - length_at(gauge, certified, environment));
        squares += u_noise * u_noise;
      };
      const bool distance = planned.measurand == Measurand::distance_error;
      if (!distance && planned.measurand != Measurand::diameter_error &&
          planned.measurand != Measurand::mean_diameter_error) {
        continue;
      }
      for (const auto& r : results) {
        for (const auto& d : r.distances) {
          if (distance && d.artefact == name) take(d.distance_mm, *gauge.distance_mm, d.u_noise_mm);
        }
        for (const auto& f : r.features) {
          if (distance || f.artefact != name || !f.diameter_mm) continue;
          take(*f.diameter_mm, gauge.diameter_mm[static_cast<std::size_t>(f.part)], f.u_noise_mm.value_or(0));
        }
      }
      add(planned.symbol, gauge, errors,
          std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, errors.size()))));
    }
  }
  return out;
}

Value to_value(const CaptureResult& r) {
  Value features = Value::array(), distances = Value::array();
  for (const auto& f : r.features) {
    Value one = Value::object().set("artefact", f.artefact).set("part", f.part);
    if (f.diameter_mm) one.set("diameter_mm", *f.diameter_mm);
    if (f.u_noise_mm) one.set("u_noise_mm", *f.u_noise_mm);
    if (f.u_calibration_mm) one.set("u_calibration_mm", *f.u_calibration_mm);
    features.append(one.set("range_mm", f.range_mm)
                        .set("shell_95_mm", f.shell_95_mm)
                        .set("sd_mm", f.sd_mm)
                        .set("place_mm", Value::numbers(f.place_mm))
                        .set("n_points", f.n_points)
                        .set("n_rejected", f.n_rejected));
  }
  for (const auto& d : r.distances) {
    distances.append(Value::object()
                         .set("artefact", d.artefact)
                         .set("distance_mm", d.distance_mm)
                         .set("u_noise_mm", d.u_noise_mm)
                         .set("u_calibration_mm", d.u_calibration_mm));
  }
  return Value::object()
      .set("schema", "fringecal.capture-result")
      .set("schema_version", 1)
      .set("capture", r.capture)
      .set("features", features)
      .set("distances", distances);
}

CaptureResult capture_result_from(const Value& value, const std::string& name) {
  Fields fields(value, name);
  fields.expect_schema("fringecal.capture-result", 1);
  CaptureResult out{.capture = fields.integer("capture")};
  for (auto& f : fields.tables("features")) {
    FeatureResult one{.artefact = f.text("artefact"), .part = f.integer("part")};
    one.diameter_mm = f.optional_number("diameter_mm");
    one.u_noise_mm = f.optional_number("u_noise_mm");
    one.u_calibration_mm = f.optional_number("u_calibration_mm");
    one.range_mm = f.number("range_mm");
    one.shell_95_mm = f.number("shell_95_mm");
    one.sd_mm = f.number("sd_mm");
    const auto place = f.numbers("place_mm", 3);
    one.place_mm = Eigen::Vector3d(place[0], place[1], place[2]);
    one.n_points = f.integer("n_points");
    one.n_rejected = f.integer("n_rejected");
    f.finish();
    out.features.push_back(one);
  }
  for (auto& d : fields.tables("distances")) {
    out.distances.push_back(
        {d.text("artefact"), d.number("distance_mm"), d.number("u_noise_mm"), d.number("u_calibration_mm")});
    d.finish();
  }
  fields.finish();
  return out;
}

}  // namespace fringecal::metrology
