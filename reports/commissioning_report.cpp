#include "reports/commissioning_report.h"

#include "core/error.h"
#include "core/file.h"
#include "reports/commissioning_sections.h"
#include "reports/number.h"
#include "reports/picture.h"
#include "reports/plot.h"

#include <fmt/format.h>

#include <limits>
#include <numeric>

namespace fringecal::reports {
namespace {

constexpr const char* kMetSign =
    "<svg viewBox=\"0 0 16 16\" aria-hidden=\"true\"><circle cx=\"8\" cy=\"8\" r=\"7.4\" fill=\"#1d6b3c\"/>"
    "<path d=\"M4.4 8.3l2.5 2.5 4.8-5.2\" fill=\"none\" stroke=\"#fff\" stroke-width=\"1.9\"/></svg>";
constexpr const char* kNotMetSign =
    "<svg viewBox=\"0 0 16 16\" aria-hidden=\"true\"><rect x=\"1.3\" y=\"1.3\" width=\"13.4\" height=\"13.4\" "
    "fill=\"#fff\" "
    "stroke=\"#a11f2a\" stroke-width=\"1.7\"/><path d=\"M4.7 4.7l6.6 6.6M11.3 4.7l-6.6 6.6\" stroke=\"#a11f2a\" "
    "stroke-width=\"1.9\"/></svg>";
constexpr const char* kNotJudgedSign =
    "<svg viewBox=\"0 0 16 16\" aria-hidden=\"true\"><circle cx=\"8\" cy=\"8\" r=\"7\" fill=\"#fff\" "
    "stroke=\"#55606c\" "
    "stroke-width=\"1.3\" stroke-dasharray=\"2.4 2\"/><path d=\"M4.8 8h6.4\" stroke=\"#55606c\" "
    "stroke-width=\"1.7\"/></svg>";

Markup contents(const CommissioningReport& report) {
  Markup links;
  const auto link = [&](bool present, const char* id, const char* words) {
    if (present) links += element("a", {{"href", std::string("#") + id}}, text(words)) + Markup::trusted("\n");
  };
  link(report.alignment.has_value(), "alignment", "Grating alignment");
  link(!report.fringes.empty(), "fringes", "Fringes");
  link(report.phase_map.has_value(), "phase", "Absolute phase");
  link(report.calibration.has_value(), "calibration", "Calibration");
  link(!report.artefacts.empty(), "artefacts", "Artefacts");
  link(!report.artefacts.empty(), "models", "What the lens model buys");
  link(true, "provenance", "Provenance");
  return element("nav", links);
}

/// "2026-11-21T23:55:16Z" -> "2026-11-21 23:55 UTC"; anything else as it stands.
std::string readable_date(const std::string& date) {
  const bool rfc3339_utc = date.size() == 20 && date[10] == 'T' && date.back() == 'Z';
  return rfc3339_utc ? date.substr(0, 10) + " " + date.substr(11, 5) + " UTC" : date;
}

Markup fact(std::string_view name, std::string_view value) {
  return element("li", element("span", text(name)) + text(" ") + text(value));
}

Markup instrument_banner(const CommissioningReport& report) {
  if (!report.virtual_instrument) {
    return report.instrument_note.empty() ? Markup() : element("p", {{"class", "note"}}, text(report.instrument_note));
  }
  Markup words = element("b", text("Virtual instrument, not a real one."));
  if (!report.instrument_note.empty()) words += text(" " + report.instrument_note);
  if (report.seed) words += text(fmt::format(" Seed {}.", *report.seed));
  return element("p", {{"class", "virtual"}}, words);
}

}  // namespace

std::string word_for(Verdict verdict) {
  switch (verdict) {
    case Verdict::met:
      return "met";
    case Verdict::not_met:
      return "not met";
    case Verdict::not_judged:
      return "not judged";
  }
  throw std::logic_error("broken contract: a verdict is one of three");
}

std::string word_for(ArtefactKind kind) {
  switch (kind) {
    case ArtefactKind::plane:
      return "plane";
    case ArtefactKind::sphere:
      return "sphere";
    case ArtefactKind::cylinder:
      return "cylinder";
  }
  throw std::logic_error("broken contract: an artefact is of one of three kinds");
}

std::string class_for(Verdict verdict) {
  return verdict == Verdict::met ? "met" : verdict == Verdict::not_met ? "not-met" : "not-judged";
}

Markup mark_sign(Verdict verdict) {
  const char* const sign = verdict == Verdict::met       ? kMetSign
                           : verdict == Verdict::not_met ? kNotMetSign
                                                         : kNotJudgedSign;
  return element("span", {{"class", "mark"}}, Markup::trusted(sign));
}

Markup mark(Verdict verdict) {
  return element("span", {{"class", "mark " + class_for(verdict)}}, mark_sign(verdict) + text(" " + word_for(verdict)));
}

Markup summary(const CommissioningReport& report) {
  Markup out =
      element("p", {{"class", "kicker"}}, element("b", text("fringecal")) + text(" · fringe-projection 3D scanner"));
  const std::string name = report.scanner_name.empty() ? "Unnamed scanner" : report.scanner_name;
  out += element("h1", text(report.title + ": " + name));
  Markup facts = fact("Date", report.provenance.date.empty() ? "not recorded" : readable_date(report.provenance.date)) +
                 fact("Program", report.provenance.program + " " + report.provenance.version);
  if (!report.stages.empty()) {
    const double total = std::accumulate(report.stages.begin(), report.stages.end(), 0.0,
                                         [](double sum, const Stage& stage) { return sum + stage.duration_s; });
    facts += fact("Duration", duration(total));
  }
  out += element("ul", {{"class", "facts"}}, facts) + instrument_banner(report);
  out +=
      element("div", {{"class", "overall"}},
              mark_sign(report.verdict) + element("p", element("span", {{"class", "word " + class_for(report.verdict)}},
                                                               text(word_for(report.verdict))) +
                                                           text(report.verdict_text)));
  Markup lines;
  for (const auto& line : report.verdicts) {
    lines += element("li", mark_sign(line.verdict) +
                               element("span", text(line.text) + element("span", {{"class", "of"}},
                                                                         text(" (" + word_for(line.verdict) + ")"))));
  }
  if (!lines.empty()) out += element("ul", {{"class", "lines"}}, lines);
  out += comparison_table(report.artefacts) + contents(report);
  return element("header", out) + Markup::trusted("\n");
}

Markup fringe_section(const CommissioningReport& report) {
  if (report.fringes.empty()) return {};
  Markup frames;
  for (const auto& frame : report.fringes) {
    frames += figure("", thumbnail(frame.image, frame.saturation_level, 330), frame.caption);
  }
  return section("fringes", "Fringes",
                 element("p", text("The frames of one capture in the order of projection: the Gray code numbers the "
                                   "stripes, the phase steps divide each period. White is the saturation level.")) +
                     element("div", {{"class", "frames"}}, frames));
}

Markup phase_section(const CommissioningReport& report) {
  if (!report.phase_map) return {};
  const auto& map = *report.phase_map;
  Image<float> shown = map.phase_rad;
  if (!map.valid.empty()) {
    require(map.valid.width() == shown.width() && map.valid.height() == shown.height(),
            "a phase map and its validity have one size");
    for (std::size_t k = 0; k < shown.size(); ++k) {
      if (map.valid.values()[k] == 0) shown.values()[k] = std::numeric_limits<float>::quiet_NaN();
    }
  }
  const HeatMapOptions options{.map = ColourMap::sequential,
                               .label = "absolute phase, rad",
                               .width_px = 760,
                               .max_height_px = 480,
                               .zoom_to_valid = false};
  return section("phase", "Absolute phase",
                 figure("", heat_map(shown, options), map.caption + " Axes in pixels; grey: no valid phase."));
}

Markup phase_correction_section(const CommissioningReport& report) {
  if (!report.phase_corrections) return {};
  const auto& corrections = *report.phase_corrections;
  Markup out;
  for (const auto& sentence : corrections.sentences) out += element("p", text(sentence));
  if (corrections.ripple_mrad) {
    const HeatMapOptions options{.map = ColourMap::sequential,
                                 .label = "amplitude, mrad",
                                 .width_px = 420,
                                 .max_height_px = 300,
                                 .zoom_to_valid = false};
    out += figure("", heat_map(*corrections.ripple_mrad, options),
                  "The fixed ripple of the phase, one value per node of the table over the picture.");
  }
  return section("corrections", "Periodic phase errors", out);
}

Markup provenance_section(const CommissioningReport& report) {
  const Provenance& from = report.provenance;
  Markup stages, inputs;
  if (!report.stages.empty()) {
    std::vector<std::vector<Markup>> rows;
    for (const auto& stage : report.stages) rows.push_back({text(stage.name), text(duration(stage.duration_s))});
    stages = element(
        "div", element("h3", text("Stages")) + table("small", {{"stage", "", ""}, {"duration", "number", ""}}, rows));
  }
  if (!from.inputs.empty()) {
    std::vector<std::vector<Markup>> rows;
    for (const auto& [name, sha256] : from.inputs) {
      rows.push_back({text(name), element("span", {{"class", "hash"}}, text(sha256))});
    }
    inputs =
        element("div", element("h3", text("Inputs")) + table("small", {{"input", "", ""}, {"SHA-256", "", ""}}, rows));
  }
  std::string made = fmt::format("Made by {} {}", from.program, from.version);
  if (!from.date.empty()) made += " on " + readable_date(from.date);
  if (report.virtual_instrument) made += ", from a virtual instrument, not a real one";
  if (report.seed) made += fmt::format(" (seed {})", *report.seed);
  return section("provenance", "Provenance",
                 element("p", text(made + ". Uncertainties are standard uncertainties u (k = 1) unless U (k = 2) is "
                                          "written; the numbers of this page, unrounded, are in report.json.")) +
                     element("div", {{"class", "columns"}}, stages + inputs));
}

std::string commissioning_html(const CommissioningReport& report) {
  const Markup body = summary(report) + alignment_section(report) + fringe_section(report) + phase_section(report) +
                      phase_correction_section(report) + calibration_section(report) + artefact_section(report) +
                      ablation_section(report) + provenance_section(report);
  return page(report.title + ": " + report.scanner_name, body);
}

void check_report_tools() { draw({.series = {{.x = {0, 1}, .y = {0, 1}}}}, "check"); }

void write_commissioning_report(const std::filesystem::path& folder, const CommissioningReport& report) {
  const std::string html = commissioning_html(report), json = to_json(to_value(report));
  write_atomically(folder / "report.html", html);
  write_atomically(folder / "report.json", json);
}

}  // namespace fringecal::reports
