#include "metrology/diagnosis.h"

#include "core/error.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <boost/math/distributions/chi_squared.hpp>

#include <algorithm>
#include <cmath>

namespace fringecal::metrology {
namespace {

constexpr const char* kHealthyName = "healthy";
constexpr double kImprobable = 1e-4;  // eq. 5

struct Evidence {
  double log_p = 0, chi2 = 0;
  Eigen::VectorXd amplitudes, u;
};

Evidence weigh(const Hypothesis& h, const Symptoms& s) {
  const auto n = s.residual.size();
  const auto m = static_cast<Eigen::Index>(h.amplitudes.size());
  require(h.effect.cols() == m && (m == 0 || h.effect.rows() == n), "a hypothesis has an effect per amplitude");
  Eigen::VectorXd variances(m);
  for (Eigen::Index k = 0; k < m; ++k) variances(k) = std::pow(h.amplitudes[static_cast<std::size_t>(k)].prior_sd, 2);
  const Eigen::MatrixXd DS = m > 0 ? Eigen::MatrixXd(h.effect * variances.asDiagonal()) : Eigen::MatrixXd(n, 0);
  Eigen::MatrixXd M = s.covariance;
  if (m > 0) M += DS * h.effect.transpose();  // eq. 2
  Evidence out;
  Eigen::LLT<Eigen::MatrixXd> solver(M);
  require(solver.info() == Eigen::Success, "the covariance of healthy symptoms is positive");
  if (m > 0) {
    const Eigen::VectorXd effect = h.effect * (DS.transpose() * solver.solve(s.residual));
    M += (kNonlinear * effect).cwiseAbs2().asDiagonal();  // E_j
    solver.compute(M);
    out.amplitudes = DS.transpose() * solver.solve(s.residual);  // eq. 4
    const Eigen::MatrixXd covariance = Eigen::MatrixXd(variances.asDiagonal()) - DS.transpose() * solver.solve(DS);
    out.u = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  }
  out.chi2 = s.residual.dot(solver.solve(s.residual));
  double log_det = 0;
  for (Eigen::Index k = 0; k < n; ++k) log_det += 2 * std::log(solver.matrixLLT()(k, k));
  out.log_p = -0.5 * (out.chi2 + log_det) + std::log(h.prior);  // the factor (2 pi)^(n/2) is common
  return out;
}

std::string words_of(const Cause& cause) {
  std::string out = cause.name;
  std::string list;
  for (const auto& a : cause.amplitudes) {
    list += fmt::format("{}{} {:+.2g} ± {:.1g} {}", list.empty() ? "" : ", ", a.name, a.value, 2 * a.u, a.unit);
  }
  return list.empty() ? out : fmt::format("{} ({})", out, list);
}

std::string sentence_of(const Diagnosis& d) {
  const std::string trueness =
      fmt::format("largest error of a length {:.4f} % ({})", d.trueness_percent, d.worst_length);
  if (d.health == Health::ok) return fmt::format("ok: {}", trueness);
  std::string cause;
  if (!d.explained) {
    cause =
        "none of the known causes explains the pattern of the deviations; look at the scanner, the artefacts and the "
        "place";
  } else if (d.named.empty()) {
    cause = "the pattern of the deviations is that of a healthy scanner: the limits may be too narrow for it";
  } else {
    std::vector<std::string> words;
    for (const auto& c : d.causes) {
      if (std::find(d.named.begin(), d.named.end(), c.name) != d.named.end()) words.push_back(words_of(c));
    }
    cause = d.named.size() == 1 ? fmt::format("likeliest cause: {}", words.front())
                                : fmt::format("cause not separable between {}", fmt::join(words, " and "));
  }
  return fmt::format("{}: {}; {}", name_of(d.health), trueness, cause);
}

}  // namespace

const char* name_of(Health health) {
  static constexpr const char* kNames[] = {"ok", "degraded", "fail"};
  return kNames[static_cast<int>(health)];
}

Diagnosis diagnose(const Symptoms& s) {
  const auto n = s.residual.size();
  require(n > 0 && s.covariance.rows() == n && s.covariance.cols() == n, "symptoms have a covariance");
  std::vector<Evidence> evidence;
  double largest = -std::numeric_limits<double>::infinity();
  for (const auto& h : s.hypotheses) {
    evidence.push_back(weigh(h, s));
    largest = std::max(largest, evidence.back().log_p);
  }
  double sum = 0;
  for (const auto& e : evidence) sum += std::exp(e.log_p - largest);
  Diagnosis out{.n_symptoms = static_cast<int>(n),
                .trueness_percent = s.trueness_percent,
                .worst_length = s.worst_length,
                .remarks = s.remarks};
  bool healthy_known = false;
  double best = -1, best_chi2 = 0;
  for (std::size_t j = 0; j < evidence.size(); ++j) {
    const double p = std::exp(evidence[j].log_p - largest) / sum;  // eq. 3
    if (p > best) {
      best = p;
      best_chi2 = evidence[j].chi2;
    }
    if (s.hypotheses[j].name == kHealthyName) {
      healthy_known = true;
      out.probability_healthy = p;
      continue;
    }
    Cause cause{s.hypotheses[j].name, p, evidence[j].chi2, {}};
    for (std::size_t k = 0; k < s.hypotheses[j].amplitudes.size(); ++k) {
      const auto& a = s.hypotheses[j].amplitudes[k];
      const auto i = static_cast<Eigen::Index>(k);
      cause.amplitudes.push_back({a.name, a.unit, evidence[j].amplitudes(i), evidence[j].u(i)});
    }
    out.causes.push_back(std::move(cause));
  }
  require(healthy_known, "one of the hypotheses is \"healthy\"");
  std::stable_sort(out.causes.begin(), out.causes.end(),
                   [](const Cause& a, const Cause& b) { return a.probability > b.probability; });
  const boost::math::chi_squared chi2(static_cast<double>(n));
  out.explained = best_chi2 <= boost::math::quantile(boost::math::complement(chi2, kImprobable));  // eq. 5
  if (out.probability_healthy < kHealthy || !out.explained) out.health = Health::degraded;
  if (out.health == Health::degraded && out.explained) {
    double held = 0;
    for (const auto& c : out.causes) {
      out.named.push_back(c.name);
      held += c.probability;
      if (held >= kNamed * (1 - out.probability_healthy)) break;
    }
  }
  out.sentence = sentence_of(out);
  return out;
}

Diagnosis with_limits(Diagnosis diagnosis, bool limits_violated) {
  if (limits_violated) diagnosis.health = Health::fail;
  diagnosis.sentence = sentence_of(diagnosis);
  return diagnosis;
}

Value to_value(const Diagnosis& d) {
  Value causes = Value::array(), named = Value::array(), remarks = Value::array();
  for (const auto& c : d.causes) {
    Value amplitudes = Value::array();
    for (const auto& a : c.amplitudes) {
      amplitudes.append(Value::object().set("name", a.name).set("unit", a.unit).set("value", a.value).set("u", a.u));
    }
    causes.append(Value::object()
                      .set("name", c.name)
                      .set("probability", c.probability)
                      .set("chi2", c.chi2)
                      .set("amplitudes", amplitudes));
  }
  for (const auto& name : d.named) named.append(name);
  for (const auto& remark : d.remarks) remarks.append(remark);
  return Value::object()
      .set("health", name_of(d.health))
      .set("sentence", d.sentence)
      .set("probability_healthy", d.probability_healthy)
      .set("trueness_percent", d.trueness_percent)
      .set("worst_length", d.worst_length)
      .set("likeliest", named)
      .set("explained", d.explained)
      .set("n_symptoms", d.n_symptoms)
      .set("causes", causes)
      .set("remarks", remarks);
}

Diagnosis diagnosis_from(Fields fields) {
  Diagnosis out;
  const std::string health = fields.text("health");
  bool known = false;
  for (const Health h : {Health::ok, Health::degraded, Health::fail}) {
    if (health == name_of(h)) {
      out.health = h;
      known = true;
    }
  }
  if (!known) fields.complain(fmt::format("health is \"{}\"; known: ok, degraded, fail", health));
  out.sentence = fields.text("sentence");
  out.probability_healthy = fields.number("probability_healthy");
  out.trueness_percent = fields.number("trueness_percent");
  out.worst_length = fields.text("worst_length");
  out.named = fields.texts("likeliest");
  out.explained = fields.boolean("explained");
  out.n_symptoms = fields.integer("n_symptoms");
  for (auto& c : fields.tables("causes")) {
    Cause cause{c.text("name"), c.number("probability"), c.number("chi2"), {}};
    for (auto& a : c.tables("amplitudes")) {
      cause.amplitudes.push_back({a.text("name"), a.text("unit"), a.number("value"), a.number("u")});
      a.finish();
    }
    c.finish();
    out.causes.push_back(std::move(cause));
  }
  out.remarks = fields.texts("remarks");
  fields.finish();
  return out;
}

}  // namespace fringecal::metrology
