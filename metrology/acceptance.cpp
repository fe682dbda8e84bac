#include "metrology/acceptance.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

namespace fringecal::metrology {
namespace {

// Digits of u that the Monte Carlo validates: with 2e5 trials an end of the interval is known to 0.006 u, below a fifth of
// the tolerance of one digit (0.05 u at least), as [JCGM101, 8.2] wants it, but not of two.
constexpr int kValidationDigits = 1;

// ---- from results to quantities

struct Reading {
  int position = 0, n = 1;  // n: captures of which it is the mean
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

struct SeriesOfPlan {
  const Plan& plan;
  const Series& series;
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

/// ", sphere A": behind the number of a position; empty where there is one part.
std::string part_words(const Gauge& gauge, int part) {
  const std::string name = part_name(gauge, part);
  if (name.empty()) return "";
  return gauge.kind == GaugeKind::step ? fmt::format(", {} plane", name) : fmt::format(", sphere {}", name);
}

/// ", 1-3": which of a plate's distances; empty where there is one.
std::string pair_words(const Gauge& gauge, const DistanceResult& d) {
  if (gauge.kind != GaugeKind::sphere_plate) return "";
  return fmt::format(", {}-{}", part_name(gauge, d.from), part_name(gauge, d.to));
}

double certified_mm(const Gauge& gauge, const DistanceResult& d) {
  for (const auto& certified : distances_of(gauge)) {
    if (certified.from == d.from && certified.to == d.to) return certified.value_mm;
  }
  throw InputError(
      fmt::format("{} has no certified length between its parts {} and {}; the captures were evaluated with "
                  "another artefacts.toml, begin in a new folder",
                  gauge.name, d.from + 1, d.to + 1));
}

/// Readings by position, each position's as their mean (eq. 7); in the order of the positions.
std::vector<Reading> means_of(const std::vector<Reading>& readings) {
  std::map<int, std::vector<const Reading*>> by_position;
  for (const auto& r : readings) by_position[r.position].push_back(&r);
  std::vector<Reading> out;
  for (const auto& [position, all] : by_position) {
    Reading mean{.position = position, .n = static_cast<int>(all.size())};
    const auto m = static_cast<double>(all.size());
    for (const Reading* r : all) {
      mean.value += r->value / m;
      mean.u_noise = std::hypot(mean.u_noise, r->u_noise / m);
      mean.u_calibration = std::max(mean.u_calibration, r->u_calibration);
      mean.n_points += r->n_points;
      mean.n_rejected += r->n_rejected;
    }
    out.push_back(mean);
  }
  return out;
}

/// "5", or "5, mean of 3".
std::string position_words(int position, int n, const char* what = "mean") {
  return n > 1 ? fmt::format("{}, {} of {}", position + 1, what, n) : fmt::format("{}", position + 1);
}

void add_diameters(std::vector<Quantity>& out, const SeriesOfPlan& of, const PlannedQuantity& planned,
                   const Gauge& gauge, const std::vector<CaptureResult>& results, const EvaluateOptions& options) {
  for (int part = 0; part < static_cast<int>(gauge.diameter_mm.size()); ++part) {
    std::vector<Reading> readings;
    for (const auto& [capture, f] : features_of(results, gauge.name, part)) {
      readings.push_back({of.series.position_of(capture), 1, *f->diameter_mm, f->u_noise_mm.value_or(0),
                          f->u_calibration_mm.value_or(0), f->n_points, f->n_rejected});
    }
    const Length length{gauge.diameter_mm[static_cast<std::size_t>(part)], gauge.U_diameter_mm};
    if (planned.measurand == Measurand::mean_diameter_error) {
      out.push_back(length_quantity(of.plan, planned, gauge, length, readings,
                                    fmt::format("mean of {}{}", readings.size(), part_words(gauge, part)), options));
      continue;
    }
    for (const auto& r : means_of(readings)) {
      out.push_back(length_quantity(of.plan, planned, gauge, length, std::span(&r, 1),
                                    position_words(r.position, r.n) + part_words(gauge, part), options));
    }
  }
}

void add_distances(std::vector<Quantity>& out, const SeriesOfPlan& of, const PlannedQuantity& planned,
                   const Gauge& gauge, const std::vector<CaptureResult>& results, const EvaluateOptions& options) {
  std::map<std::pair<int, int>, std::vector<Reading>> readings;  // by the parts between which they are
  for (const auto& r : results) {
    for (const auto& d : r.distances) {
      if (d.artefact != gauge.name) continue;
      Reading reading{of.series.position_of(r.capture), 1, d.distance_mm, d.u_noise_mm, d.u_calibration_mm};
      for (const auto& f : r.features) {
        if (f.artefact != gauge.name || (f.part != d.from && f.part != d.to)) continue;
        reading.n_points += f.n_points;
        reading.n_rejected += f.n_rejected;
      }
      readings[{d.from, d.to}].push_back(reading);
    }
  }
  for (int position = 0; position < of.series.positions(); ++position) {
    for (const auto& [parts, all] : readings) {
      const DistanceResult between{.artefact = gauge.name, .from = parts.first, .to = parts.second};
      for (const auto& r : means_of(all)) {
        if (r.position != position) continue;
        out.push_back(length_quantity(of.plan, planned, gauge, {certified_mm(gauge, between), gauge.U_distance_mm},
                                      std::span(&r, 1), position_words(r.position, r.n) + pair_words(gauge, between),
                                      options));
      }
    }
  }
}

void add_forms(std::vector<Quantity>& out, const SeriesOfPlan& of, const PlannedQuantity& planned, const Gauge& gauge,
               const std::vector<CaptureResult>& results) {
  const auto value_of = [&](const FeatureResult& f) {
    return planned.measurand == Measurand::form_sd      ? f.sd_mm
           : planned.measurand == Measurand::form_range ? f.range_mm
                                                        : f.shell_95_mm;
  };
  const int parts = static_cast<int>(nominals_of(gauge).size());
  for (int part = 0; part < parts; ++part) {
    const auto features = features_of(results, gauge.name, part);
    if (features.empty()) continue;
    std::map<int, std::vector<const FeatureResult*>> by_position;  // all captures at once: the largest of them
    for (const auto& [capture, f] : features) {
      const bool all = planned.measurand == Measurand::form_sd;
      by_position[all ? 0 : of.series.position_of(capture)].push_back(f);
    }
    for (const auto& [position, some] : by_position) {
      const FeatureResult& largest = **std::max_element(
          some.begin(), some.end(), [&](const auto* a, const auto* b) { return value_of(*a) < value_of(*b); });
      const std::string words = planned.measurand == Measurand::form_sd
                                    ? fmt::format("largest of {}", some.size())
                                    : position_words(position, static_cast<int>(some.size()), "largest");
      out.push_back(
          form_quantity(of.plan, planned, gauge, value_of(largest), largest, words + part_words(gauge, part)));
    }
  }
}

/// Where a length was read: position, and between which parts of the artefact.
using Place = std::array<int, 3>;
using ErrorsByPlace = std::map<Place, std::vector<double>>;

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double squares_about(double mean, const std::vector<double>& values) {
  double out = 0;
  for (const double v : values) out += (v - mean) * (v - mean);
  return out;
}

}  // namespace

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
          add_diameters(out, {plan, series}, planned, gauge, results, options);
          break;
        case Measurand::distance_error:
          add_distances(out, {plan, series}, planned, gauge, results, options);
          break;
        case Measurand::form_range:
        case Measurand::form_95:
        case Measurand::form_sd:
          add_forms(out, {plan, series}, planned, gauge, results);
          break;
      }
    }
  }
  return out;
}

std::vector<GaugeSummary> summaries_of(const Series& series, const std::vector<Gauge>& gauges,
                                       const std::vector<CaptureResult>& results, const Environment& environment) {
  std::vector<GaugeSummary> out;
  const auto add = [&](const std::string& symbol, const Gauge& gauge, const ErrorsByPlace& errors, double noise) {
    int readings = 0;
    double within = 0;  // squares about the places' means
    std::vector<double> means;
    for (const auto& [place, all] : errors) {
      readings += static_cast<int>(all.size());
      means.push_back(mean_of(all));
      within += squares_about(means.back(), all);
    }
    const auto places = static_cast<int>(means.size());
    GaugeSummary s{symbol, gauge.name, readings, series.repeats, mean_of(means)};
    s.repeatability_mm = readings > places ? std::sqrt(within / (readings - places)) : noise;  // eq. 1
    if (!series.repeats && places > 1) {
      const double variance = squares_about(s.mean_mm, means) / (places - 1),
                   of_a_mean = s.repeatability_mm * s.repeatability_mm / series.captures_per_position;
      s.reproducibility_mm = std::sqrt(std::max(0.0, variance - of_a_mean));  // eq. 2
    }
    out.push_back(s);
  };
  for (const auto& planned : series.quantities) {
    for (const auto& name : series.artefacts) {
      const Gauge& gauge = gauge_named(gauges, name);
      ErrorsByPlace errors;
      double squares = 0;
      int readings = 0;
      const auto take = [&](const Place& place, double measured, double certified, double u_noise) {
        errors[series.repeats ? Place{} : place].push_back(measured - length_at(gauge, certified, environment));
        squares += u_noise * u_noise;
        ++readings;
      };
      const bool distance = planned.measurand == Measurand::distance_error;
      if (!distance && planned.measurand != Measurand::diameter_error &&
          planned.measurand != Measurand::mean_diameter_error) {
        continue;
      }
      for (const auto& r : results) {
        const int position = series.position_of(r.capture);
        for (const auto& d : r.distances) {
          if (!distance || d.artefact != name) continue;
          take({position, d.from, d.to}, d.distance_mm, certified_mm(gauge, d), d.u_noise_mm);
        }
        for (const auto& f : r.features) {
          if (distance || f.artefact != name || !f.diameter_mm) continue;
          take({position, f.part, f.part}, *f.diameter_mm, gauge.diameter_mm[static_cast<std::size_t>(f.part)],
               f.u_noise_mm.value_or(0));
        }
      }
      if (readings > 1) add(planned.symbol, gauge, errors, std::sqrt(squares / readings));
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
                         .set("from", d.from)
                         .set("to", d.to)
                         .set("distance_mm", d.distance_mm)
                         .set("u_noise_mm", d.u_noise_mm)
                         .set("u_calibration_mm", d.u_calibration_mm));
  }
  Value out = Value::object()
                  .set("schema", "fringecal.capture-result")
                  .set("schema_version", 1)
                  .set("capture", r.capture)
                  .set("features", features)
                  .set("distances", distances);
  if (r.joined) {
    out.set("joined_views", Value::object()
                                .set("views", r.joined->views)
                                .set("references", r.joined->references)
                                .set("rms_mm", r.joined->rms_mm));
  }
  return out;
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
    DistanceResult one{.artefact = d.text("artefact")};
    one.from = d.optional_integer("from").value_or(0);
    one.to = d.optional_integer("to").value_or(1);
    one.distance_mm = d.number("distance_mm");
    one.u_noise_mm = d.number("u_noise_mm");
    one.u_calibration_mm = d.number("u_calibration_mm");
    d.finish();
    out.distances.push_back(one);
  }
  if (auto joined = fields.optional_table("joined_views")) {
    out.joined = JoinedViews{joined->integer("views"), joined->integer("references"), joined->number("rms_mm")};
    joined->finish();
  }
  fields.finish();
  return out;
}

}  // namespace fringecal::metrology
