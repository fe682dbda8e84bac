#include "reports/commissioning_sections.h"
#include "reports/number.h"
#include "reports/picture.h"
#include "reports/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::reports {
namespace {

constexpr double kUmPerMm = 1000.0;
constexpr std::size_t kRepeatsPerTable = 10;

std::string um(double mm) { return significant(kUmPerMm * mm, 3); }
/// A limit or a published figure: "40", not "40.0".
std::string um_exact(double mm) { return without_end_zeros(um(mm)); }

Markup none() { return element("span", {{"class", "of"}}, text("–")); }

/// Ours as a share of the paper's figure: the tick stands at the paper's figure, the end of the track at 1.25 of it. The
/// paper's figure is no limit: only what is judged not met is drawn in the colour of it.
Markup bar(double ours, double limit, Verdict verdict) {
  constexpr double kWidth = 72, kEnd = 1.25;
  const double share = limit > 0 ? std::abs(ours) / limit : kEnd;
  return Markup::trusted(
      fmt::format("<svg class=\"bar\" viewBox=\"0 0 72 7\" aria-hidden=\"true\"><rect class=\"track\" y=\"2\" "
                  "width=\"72\" height=\"3\"/>"
                  "<rect class=\"{}\" y=\"1.5\" width=\"{:.1f}\" height=\"4\"/><rect class=\"limit\" x=\"{:.1f}\" "
                  "width=\"1.4\" height=\"7\"/></svg>",
                  share > 1.0 && verdict == Verdict::not_met ? "over" : "fill", kWidth * std::min(share / kEnd, 1.0),
                  kWidth / kEnd - 0.7));
}

/// The error rounded by its uncertainty, both in um.
struct ErrorWords {
  std::string error, u;
};

ErrorWords error_words(const ModelResult& result) {
  if (!result.error_mm) return {};
  if (!result.u_error_mm) return {with_sign(um(*result.error_mm)), ""};
  const Rounded r = rounded(kUmPerMm * *result.error_mm, kUmPerMm * *result.u_error_mm);
  return {with_sign(r.value), r.u};
}

std::string mean_words(const ModelResult& result) {
  if (!result.mean_diameter_mm) return {};
  return result.u_error_mm ? rounded(*result.mean_diameter_mm, *result.u_error_mm).value
                           : fixed(*result.mean_diameter_mm, 4);
}

Markup or_none(const std::string& words) { return words.empty() ? none() : text(words); }

std::string certificate_words(const Uncertain& certificate) {
  const Rounded r = rounded(certificate.value, 2.0 * certificate.u);
  return r.value + " ± " + r.u;
}

std::vector<Markup> comparison_row(const ArtefactSection& a) {
  Markup name = text(a.name);
  if (!a.repeats.empty()) {
    name += element("span", {{"class", "sub"}},
                    text(fmt::format("{} {}", a.repeats.size(), a.repeats.size() == 1 ? "repeat" : "repeats")));
  }
  const Markup certificate = a.certificate_mm ? text(certificate_words(*a.certificate_mm)) : none();
  const Markup paper_error = a.paper.error_limit_mm ? text("< " + um_exact(*a.paper.error_limit_mm)) : none();
  const Markup paper_form = a.paper.form_sd_mm ? text(um_exact(*a.paper.form_sd_mm)) : none();
  if (a.models.empty()) {
    return {name, certificate, none(), none(), none(), none(), paper_error, paper_form, mark(a.verdict)};
  }
  const ModelResult& ours = a.models.front();
  const ErrorWords words = error_words(ours);
  Markup error = or_none(words.error), form = text(um(ours.max_form_sd_mm));
  if (ours.error_mm && a.paper.error_limit_mm) error += bar(*ours.error_mm, *a.paper.error_limit_mm, a.verdict);
  if (a.paper.form_sd_mm) form += bar(ours.max_form_sd_mm, *a.paper.form_sd_mm, a.verdict);
  return {name,       certificate,    or_none(mean_words(ours)), error, or_none(words.u), form, paper_error,
          paper_form, mark(a.verdict)};
}

Markup form_plot(const ArtefactSection& a, const std::string& id) {
  Series s{.label = "", .mark = Mark::line_points, .size = 0.5, .x = {}, .y = {}};
  double top = 0;
  for (std::size_t k = 0; k < a.repeats.size(); ++k) {
    s.x.push_back(static_cast<double>(k + 1));
    s.y.push_back(kUmPerMm * a.repeats[k].form_sd_mm);
    top = std::max(top, s.y.back());
  }
  Plot plot{.width_px = 500,
            .height_px = 165,
            .x = {.label = "repeat",
                  .range = std::pair(0.5, static_cast<double>(a.repeats.size()) + 0.5),
                  .tick = a.repeats.size() <= 20 ? std::optional(1.0) : std::nullopt},
            .y = {.label = "form sd, µm", .range = {}, .tick = {}},
            .right = {},
            .series = {s},
            .bands = {},
            .levels = {}};
  if (a.paper.form_sd_mm) {
    const double level = kUmPerMm * *a.paper.form_sd_mm;
    plot.levels.push_back({level, "paper " + um_exact(*a.paper.form_sd_mm)});
    top = std::max(top, level);
  }
  plot.y.range = std::pair(0.0, std::max(1.25 * top, 1e-6));
  return draw(plot, id);
}

/// Diameters about the certificate; without one, about their mean.
Markup diameter_plot(const ArtefactSection& a, const std::string& id) {
  const double origin = a.certificate_mm ? a.certificate_mm->value : a.models.front().mean_diameter_mm.value();
  Series s{.label = "", .mark = Mark::line_points, .size = 0.5, .x = {}, .y = {}};
  double reach = 0;
  for (std::size_t k = 0; k < a.repeats.size(); ++k) {
    if (!a.repeats[k].diameter_mm) continue;
    s.x.push_back(static_cast<double>(k + 1));
    s.y.push_back(kUmPerMm * (*a.repeats[k].diameter_mm - origin));
    reach = std::max(reach, std::abs(s.y.back()));
  }
  Plot plot{.width_px = 500,
            .height_px = 165,
            .x = {.label = "repeat",
                  .range = std::pair(0.5, static_cast<double>(a.repeats.size()) + 0.5),
                  .tick = a.repeats.size() <= 20 ? std::optional(1.0) : std::nullopt},
            .y = {.label = "diameter error, µm", .range = {}, .tick = {}},
            .right = {},
            .series = {s},
            .bands = {},
            .levels = {{0.0, a.certificate_mm ? "certificate" : "mean"}}};
  if (!a.certificate_mm) plot.y.label = "diameter − mean, µm";
  if (a.certificate_mm && a.paper.error_limit_mm) {
    const double limit = kUmPerMm * *a.paper.error_limit_mm;
    plot.levels.push_back({limit, "paper ±" + um_exact(*a.paper.error_limit_mm)});
    plot.levels.push_back({-limit, ""});
    reach = std::max(reach, limit);
  }
  plot.y.range = std::pair(-1.3 * std::max(reach, 1e-6), 1.3 * std::max(reach, 1e-6));
  return draw(plot, id);
}

/// One column per repeat, ten to a table.
Markup repeat_tables(const ArtefactSection& a) {
  Markup out;
  for (std::size_t first = 0; first < a.repeats.size(); first += kRepeatsPerTable) {
    const std::size_t end = std::min(first + kRepeatsPerTable, a.repeats.size());
    std::vector<Column> columns = {{"repeat", "", ""}};
    std::vector<Markup> diameter = {text("diameter, mm")}, form = {text("form sd, µm")}, points = {text("points")},
                        rejected = {text("rejected")};
    bool any_diameter = false;
    for (std::size_t k = first; k < end; ++k) {
      const Repeat& r = a.repeats[k];
      any_diameter = any_diameter || r.diameter_mm.has_value();
      columns.push_back({std::to_string(k + 1), "number", ""});
      diameter.push_back(r.diameter_mm ? text(fixed(*r.diameter_mm, 4)) : none());
      form.push_back(text(um(r.form_sd_mm)));
      points.push_back(text(std::to_string(r.n_points)));
      rejected.push_back(text(std::to_string(r.n_rejected)));
    }
    std::vector<std::vector<Markup>> rows;
    if (any_diameter) rows.push_back(diameter);
    rows.insert(rows.end(), {form, points, rejected});
    out += table("small full", columns, rows);
  }
  return out;
}

std::string sentence_for(const ArtefactSection& a) {
  std::string out;
  if (!a.models.empty()) {
    const ModelResult& ours = a.models.front();
    const ErrorWords words = error_words(ours);
    if (!words.error.empty())
      out += fmt::format("Error {} µm{}. ", words.error, words.u.empty() ? "" : ", u = " + words.u + " µm");
    if (ours.repeatability_sd_mm)
      out += fmt::format("Repeatability of the diameter {} µm. ", um(*ours.repeatability_sd_mm));
    out += fmt::format("Form standard deviation {} µm in the mean, {} µm at most. ", um(ours.mean_form_sd_mm),
                       um(ours.max_form_sd_mm));
  } else {
    out += "Not measured. ";
  }
  if (!a.paper.text.empty()) out += "Paper: " + a.paper.text + ". ";
  if (!a.criterion.empty()) out += "Judged against: " + a.criterion + ".";
  return out;
}

Markup one_artefact(const ArtefactSection& a, std::size_t number) {
  Markup out = element("h3", element("span", text(a.name)) + mark(a.verdict));
  out += element("p", {{"class", "note"}}, text(sentence_for(a)));
  Markup map, plots;
  if (!a.deviation_mm.empty()) {
    const HeatMapOptions options{.map = ColourMap::diverging,
                                 .label = "deviation, µm",
                                 .scale = kUmPerMm,
                                 .width_px = 480,
                                 .max_height_px = 285};
    map = figure(
        "half", heat_map(a.deviation_mm, options),
        (a.deviation_caption.empty() ? "Deviation from the fitted " + word_for(a.kind) + "." : a.deviation_caption) +
            " Axes in pixels; grey: no point.");
  }
  if (!a.repeats.empty()) {
    const bool diameters =
        std::all_of(a.repeats.begin(), a.repeats.end(), [](const Repeat& r) { return r.diameter_mm.has_value(); });
    if (diameters && (a.certificate_mm || (!a.models.empty() && a.models.front().mean_diameter_mm))) {
      plots += diameter_plot(a, fmt::format("diameter_{}", number));
    }
    plots += form_plot(a, fmt::format("form_{}", number));
    plots = figure("half", plots, plots.empty() ? "" : "Each repeat: a new capture.");
  }
  if (!map.empty() || !plots.empty()) out += element("div", {{"class", "figures"}}, map + plots);
  out += repeat_tables(a);
  for (const auto& remark : a.remarks) out += element("p", {{"class", "note"}}, text(remark));
  return element("div", {{"class", "artefact"}}, out);
}

std::string title_of_model(const std::string& model) {
  if (model == "full") return "full ray model";
  if (model == "chen2008") return "paper, eqs. 1–20";
  if (model == "ideal") return "ideal lenses, eqs. 1–17";
  return model;
}

}  // namespace

Markup comparison_table(const std::vector<ArtefactSection>& artefacts) {
  if (artefacts.empty()) return {};
  const std::vector<Column> columns = {{"artefact", "", ""},
                                       {"certificate ± U, mm", "number", ""},
                                       {"mean, mm", "number", "this scanner"},
                                       {"error, µm", "number", "this scanner"},
                                       {"u, µm", "number", "this scanner"},
                                       {"max. form sd, µm", "number", "this scanner"},
                                       {"error, µm", "number", "the paper"},
                                       {"max. form sd, µm", "number", "the paper"},
                                       {"verdict", "", ""}};
  std::vector<std::vector<Markup>> rows;
  rows.reserve(artefacts.size());
  for (const auto& a : artefacts) rows.push_back(comparison_row(a));
  return element(
      "div", {{"class", "compare"}},
      table("full", columns, rows) +
          element(
              "p", {{"class", "note"}},
              text("Error: mean of the repeats − certificate. U: k = 2; u: standard uncertainty of the error. Form sd: "
                   "standard deviation of the points from the fitted element, the largest of the repeats. Bars: "
                   "this scanner’s figure as a share of the paper’s, which is the tick. Paper: Chen, Xi, Jiang, Jin, "
                   "Precision Engineering 32 (2008) 215–221.")));
}

Markup artefact_section(const CommissioningReport& report) {
  if (report.artefacts.empty()) return {};
  Markup out;
  for (std::size_t k = 0; k < report.artefacts.size(); ++k) out += one_artefact(report.artefacts[k], k);
  return section("artefacts", "Artefacts", out);
}

Markup ablation_section(const CommissioningReport& report) {
  std::vector<std::string> models;
  for (const auto& a : report.artefacts) {
    for (const auto& m : a.models) {
      if (std::find(models.begin(), models.end(), m.model) == models.end()) models.push_back(m.model);
    }
  }
  if (models.empty()) return {};
  std::vector<Column> columns = {{"artefact", "", ""}};
  for (const auto& model : models) {
    columns.push_back({"error, µm", "number", title_of_model(model)});
    columns.push_back({"max. form sd, µm", "number", title_of_model(model)});
  }
  std::vector<std::vector<Markup>> rows;
  for (const auto& a : report.artefacts) {
    std::vector<Markup> row = {text(a.name)};
    for (const auto& model : models) {
      const auto found =
          std::find_if(a.models.begin(), a.models.end(), [&](const ModelResult& m) { return m.model == model; });
      const bool present = found != a.models.end();
      row.push_back(present ? or_none(error_words(*found).error) : none());
      row.push_back(present ? text(um(found->max_form_sd_mm)) : none());
    }
    rows.push_back(row);
  }
  return section(
      "models", "What the lens model buys",
      element("p",
              text("The same captures and the same calibration, reconstructed with each model: the full ray model, the "
                   "paper’s closed form with its distortion terms, and the closed form with ideal lenses.")) +
          table("full", columns, rows));
}

}  // namespace fringecal::reports
