#include "reports/instrument_report.h"

#include "core/fields.h"
#include "reports/catalogue.h"
#include "reports/certificate.h"
#include "reports/certificate_html.h"
#include "reports/number.h"
#include "reports/svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace fringecal::reports {
namespace {

/// A page with the certificate's head, margins and end.
std::string page_of(const std::string& title, const std::string& subject, const Markup& body, const Catalogue& words,
                    const std::string& language) {
  const Markup head =
      element("div", {{"class", "letterhead"}}, element("div", {{"class", "laboratory"}}, text("fringecal"))) +
      element("h1", text(title)) + element("p", {{"class", "number"}}, element("b", text(subject)));
  const Markup running = element("div", {{"class", "running-laboratory"}}, text(subject)) +
                         element("div", {{"class", "running-title"}}, text(title)) +
                         element("div", {{"class", "running-test"}}, Markup());
  const Markup end = element("p", {{"class", "end"}}, text(words("title.report_end")));
  const std::string page_number =
      fmt::format("@page{{@bottom-right{{content:\"{} \" counter(page) \" {} \" counter(pages)}}}}",
                  words("title.page"), words("title.of"));
  return "<!DOCTYPE html>\n<html lang=\"" + escape(language) +
         "\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" "
         "content=\"width=device-width,initial-scale=1\">\n" +
         element("title", text(title + " " + subject)).html() + "\n<style>" + kCertificateStyle + page_number +
         "</style>\n</head>\n<body>\n" + element("main", running + element("header", head) + body + end).html() +
         "\n</body>\n</html>\n";
}

Markup part(const std::string& heading, const Markup& content) {
  return element("section", element("h2", text(heading)) + content);
}

Markup fact(const std::string& name, const Markup& value) {
  return element("tr", element("th", {{"scope", "row"}}, text(name)) + element("td", value));
}

Markup facts(const Markup& rows) { return element("table", {{"class", "facts"}}, element("tbody", rows)); }

std::string unit_of(const std::string& parameter, const model::Scanner& scanner) {
  for (const auto& [end, unit] : {std::pair("_px", "px"), std::pair("_mm", "mm"), std::pair("_rad", "rad")}) {
    if (parameter.ends_with(end)) return unit;
  }
  const auto axis = scanner.projector.axis(scanner.projector.main_axis());
  return parameter.ends_with(".f") || parameter.ends_with(".u0") ? axis->code.unit : "1";
}

Markup parameters(const model::Scanner& scanner, const Catalogue& words) {
  std::vector<std::vector<Markup>> rows;
  for (const auto& name : scanner.uncertainty.names) {
    const double u = scanner.uncertainty.u(name).value_or(0);
    const Rounded both = rounded(scanner.value_of(name), u);
    rows.push_back({text(name), text(both.value), text(both.u), unit(unit_of(name, scanner))});
  }
  return table("small",
               {{words("instrument.parameter"), "", ""},
                {words("results.value"), "number", ""},
                {"u", "number", ""},
                {words("instrument.unit"), "", ""}},
               rows);
}

Markup residuals(const model::Scanner& scanner, const Catalogue& words) {
  const auto& r = scanner.residuals;
  return facts(fact(words("instrument.camera_rms"), text(significant(r.camera_rms_px, 3) + "\u00a0px")) +
               fact(words("instrument.projector_rms"),
                    text(significant(r.projector_rms, 3) + "\u00a0") + unit(r.projector_unit)) +
               fact(words("instrument.grid_rms"), text(significant(r.grid_rms_mm, 3) + "\u00a0mm")) +
               fact(words("instrument.chi2"), text(significant(r.chi2_per_dof, 3))) +
               fact(words("instrument.corners"),
                    text(words("instrument.used_rejected", {{"used", std::to_string(r.corners_used)},
                                                            {"rejected", std::to_string(r.corners_rejected)},
                                                            {"poses", std::to_string(r.poses)}}))));
}

/// Residuals of the used corners' places are not stored: what is drawn is where the corners were.
Markup coverage(const model::Scanner& scanner, const Catalogue& words) {
  constexpr double kWidth = 400;
  const double scale = kWidth / scanner.camera.width_px, height = scanner.camera.height_px * scale;
  std::string out =
      svg::begin("coverage", kWidth, height + 2) + svg::box(0.5, 0.5, kWidth - 1, height - 1, "none", svg::kInk, 0.8);
  std::size_t n = 0;
  for (const auto& board : scanner.observations) {
    for (const auto& corner : board.corners) {
      out += corner.used ? fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"0.8\" fill=\"{}\"/>",
                                       corner.pixel.x() * scale, corner.pixel.y() * scale, svg::kBlue)
                         : svg::mark(svg::Mark::cross, corner.pixel.x() * scale, corner.pixel.y() * scale, 1.8);
      ++n;
    }
  }
  return n == 0 ? Markup() : figure("wide", Markup::trusted(out + svg::kEnd), words("instrument.coverage"));
}

/// More input files than these are not listed: the record holds their hashes, and its own stands in the report.
constexpr std::size_t kMostInputs = 12;

Markup origin(const std::string& sha256, const Provenance* provenance, const Catalogue& words) {
  Markup out = element("p", {{"class", "hash"}}, text("SHA-256 " + sha256));
  if (provenance != nullptr) {
    out += element("p", {{"class", "hash"}},
                   text(words("method.software", {{"program", provenance->program}, {"version", provenance->version}}) +
                        " " + provenance->date));
    if (provenance->inputs.size() > kMostInputs) {
      out += element("p", {{"class", "hash"}},
                     text(words("instrument.inputs", {{"n", std::to_string(provenance->inputs.size())}})));
    } else {
      for (const auto& [name, hash] : provenance->inputs) {
        out += element("p", {{"class", "hash"}}, text(fmt::format("{} {}", name, hash)));
      }
    }
  }
  return part(words("remarks.origin"), out);
}

struct Turn {
  int number = 0, bit = 0;
  double theta_mrad = 0, u_theta_mrad = 0, delta_um = 0, u_delta_um = 0, tolerance_um = 0, turn_before_mrad = 0;
  std::string sentence;
};

std::vector<Turn> turns_of(const Value& record, const std::string& name) {
  Fields fields(record, name);
  fields.expect_schema("fringecal.alignment_record", 1);
  std::vector<Turn> out;
  for (auto& iteration : fields.tables("iterations")) {
    Fields measured = iteration.table("measured"), step = iteration.table("step");
    Turn t{.number = static_cast<int>(out.size())};
    t.theta_mrad = measured.number("theta_mrad");
    t.u_theta_mrad = measured.number("u_theta_mrad");
    t.bit = step.integer("bit");
    t.delta_um = step.number("delta_um");
    t.u_delta_um = step.number("u_delta_um");
    t.tolerance_um = step.number("tolerance_um");
    t.turn_before_mrad = iteration.number("turn_before_mrad");
    t.sentence = step.text("sentence");
    out.push_back(std::move(t));
  }
  if (out.empty()) fields.complain("the record holds no iteration");
  return out;
}

Markup turns_table(const std::vector<Turn>& turns, const Catalogue& words) {
  std::vector<std::vector<Markup>> rows;
  rows.reserve(turns.size());
  const auto pair = [](double value, double u) {
    const Stated s = stated(value, 2 * u);
    return text(shown(s.value) + " ± " + s.U);
  };
  for (const auto& t : turns) {
    rows.push_back({text(std::to_string(t.number)), text(shown(fixed(t.turn_before_mrad, 3))),
                    pair(t.theta_mrad, t.u_theta_mrad), pair(t.delta_um, t.u_delta_um), text(std::to_string(t.bit)),
                    text(t.sentence)});
  }
  return table("small",
               {{words("results.line"), "", ""},
                {words("instrument.turned") + ", mrad", "number", ""},
                {"θ ± U (k = 2), mrad", "number", ""},
                {"δ ± U (k = 2), µm", "number", ""},
                {words("instrument.bit"), "number", ""},
                {words("instrument.outcome"), "", ""}},
               rows);
}

/// One quantity over the iterations, with its tolerance where it has one: then the picture is at least half tolerance,
/// and a value beyond it is an arrow with its figure.
std::string panel(double left, const char* title, const std::vector<double>& values, const std::vector<double>& U,
                  double tolerance) {
  constexpr double kWidth = 300, kHeight = 170, kTop = 22, kLeft = 46, kFoot = 20, kMargin = 1.1;
  double most = tolerance;
  for (std::size_t k = 0; k < values.size(); ++k) most = std::max(most, std::abs(values[k]) + U[k]);
  if (tolerance > 0) most = std::min(most, 2 * tolerance);
  const double end = most > 0 ? kMargin * most : 1;
  const auto y_of = [&](double v) {
    return kTop + (kHeight - kTop - kFoot) * (0.5 - 0.5 * std::clamp(v / end, -1.0, 1.0));
  };
  const auto x_of = [&](std::size_t k) {
    return left + kLeft + (kWidth - kLeft) * (static_cast<double>(k) + 0.5) / static_cast<double>(values.size());
  };
  std::string out = svg::words(left + kLeft, 13, "start", title, 9.5);
  const double x0 = left + kLeft, x1 = left + kWidth;
  if (tolerance > 0) {
    out += svg::box(x0, y_of(end), x1 - x0, y_of(tolerance) - y_of(end), svg::kBeyond) +
           svg::box(x0, y_of(-tolerance), x1 - x0, y_of(-end) - y_of(-tolerance), svg::kBeyond);
  }
  out += svg::line(x0, y_of(0), x1, y_of(0), svg::kInk, 0.8) +
         svg::box(x0, kTop, x1 - x0, kHeight - kTop - kFoot, "none", svg::kQuiet, 0.7);
  const double tick = tolerance > 0 ? tolerance : most;
  for (const double value : {-tick, 0.0, tick}) {
    out += svg::words(x0 - 5, y_of(value) + 3.2, "end", shown(significant(value, 2)), 8.5);
  }
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double x = x_of(k), v = values[k];
    if (std::abs(v) > end) {
      const double y = y_of(v), inward = v > 0 ? 1 : -1;
      out += svg::line(x, y + 14 * inward, x, y + 2 * inward, svg::kBlue, 1.4) +
             svg::line(x - 4, y + 7 * inward, x, y + 2 * inward, svg::kBlue, 1.4) +
             svg::line(x + 4, y + 7 * inward, x, y + 2 * inward, svg::kBlue, 1.4) +
             svg::words(x + 8, y + (v > 0 ? 12 : -5), "start", shown(significant(v, 3)), 8.5);
    } else {
      out += svg::line(x, y_of(v - U[k]), x, y_of(v + U[k]), svg::kBlue, 1.4) +
             svg::mark(k == 0 ? svg::Mark::circle : svg::Mark::disc, x, y_of(v));
    }
    out += svg::words(x, kHeight - 6, "middle", std::to_string(k), 8.5);
  }
  return out;
}

Markup course(const std::vector<Turn>& turns, const Catalogue& words) {
  std::vector<double> theta, U_theta, delta, U_delta;
  for (const auto& t : turns) {
    theta.push_back(t.theta_mrad);
    U_theta.push_back(2 * t.u_theta_mrad);
    delta.push_back(t.delta_um);
    U_delta.push_back(2 * t.u_delta_um);
  }
  const std::string drawing = svg::begin("turns", 640, 172) + panel(0, "θ / mrad", theta, U_theta, 0) +
                              panel(330, "δ / µm", delta, U_delta, turns.back().tolerance_um) + svg::kEnd;
  return figure("wide", Markup::trusted(drawing), words("instrument.course"));
}

}  // namespace

InstrumentReport calibration_report(const model::Scanner& scanner, const std::string& sha256,
                                    const std::string& language) {
  const Catalogue& words = Catalogue::in(language);
  InstrumentReport out{.title = words("instrument.calibration"), .results = scanner.uncertainty.names.size()};
  Markup model = element("p", text(scanner.method)) +
                 facts(fact(words("instrument.base"), text(fixed(scanner.base_mm(), 3) + "\u00a0mm")) +
                       fact(words("instrument.distance"), text(fixed(scanner.working_distance_mm, 3) + "\u00a0mm")));
  Markup priors;
  for (const auto& prior : scanner.priors) {
    priors += element("li", text(fmt::format("{}: {} ± {}. {}", prior.parameter, exact(prior.value),
                                             two_digits(prior.u), prior.reason)));
  }
  if (!priors.empty()) model += element("h3", text(words("instrument.priors"))) + element("ul", priors);
  const Markup body = part(words("method.heading"), model) +
                      part(words("instrument.residuals"), residuals(scanner, words) + coverage(scanner, words)) +
                      part(words("instrument.parameters"), parameters(scanner, words)) +
                      origin(sha256, &scanner.provenance, words);
  out.html = page_of(out.title, scanner.name, body, words, language);
  return out;
}

InstrumentReport alignment_report(const Value& record, const std::string& name, const std::string& sha256,
                                  const std::string& language) {
  const Catalogue& words = Catalogue::in(language);
  const auto turns = turns_of(record, name);
  InstrumentReport out{.title = words("instrument.alignment"), .results = turns.size()};
  const Markup body = part(words("results.heading"), element("p", text(turns.back().sentence)) +
                                                         turns_table(turns, words) + course(turns, words)) +
                      origin(sha256, nullptr, words);
  out.html = page_of(out.title, std::filesystem::path(name).filename().string(), body, words, language);
  return out;
}

}  // namespace fringecal::reports
