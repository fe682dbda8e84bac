#include "reports/plan_page.h"

#include "reports/html.h"
#include "reports/plot.h"

#include <array>

namespace fringecal::reports {
namespace {

constexpr std::array kColours = {ink::kSecondary, ink::kPrimary, "#3c7a3c", "#7a3c7a"};

enum class View { front, side };

Plot drawing(const PlanPage& content, View view) {
  Plot plot{.width_px = 520, .height_px = 430, .x = {.label = "X / mm"}, .y = {.label = "Y / mm"}};
  if (view == View::side) plot.y.label = "Z / mm";
  plot.equal_scales = true;
  const auto add = [&](const std::string& label, const char* colour, double width, const SpaceLine& line) {
    Series s{.label = label, .colour = colour, .size = width, .x = line.x, .y = view == View::front ? line.y : line.z};
    plot.series.push_back(std::move(s));
  };
  bool first = true;
  for (const auto& line : content.camera_field) {
    add(first ? "camera" : "", ink::kQuiet, 1.0, line);
    first = false;
  }
  first = true;
  for (const auto& line : content.coded_field) {
    add(first ? "code" : "", ink::kBand, 1.6, line);
    first = false;
  }
  std::size_t k = 0;
  for (const auto& series : content.series) {
    first = true;
    for (const auto& line : series.lines) {
      add(first ? series.label : "", kColours[k % kColours.size()], 1.4, line);
      first = false;
    }
    ++k;
  }
  return plot;
}

}  // namespace

std::string plan_page(const PlanPage& content) {
  Markup body = element("h1", text(content.title)) + element("p", text(content.scanner));
  body += figure("half", draw(drawing(content, View::front), "front"),
                 "Places of the artefacts, and what camera and code cover at the lowest, middle and highest of them.");
  body += figure("half", draw(drawing(content, View::side), "side"), "The same from the side.");
  for (const auto& problem : content.problems) body += element("p", {{"class", "failed"}}, text(problem));
  std::vector<std::vector<Markup>> rows;
  for (const auto& r : content.rows) {
    rows.push_back({text(r.symbol), text(r.artefact), text(r.position), text(r.U_mm), text(r.limits), text(r.share),
                    text(r.u_later_mm)});
  }
  body += section("prediction", "Predicted uncertainty of the test values",
                  element("p", text(content.assumption)) + table("plain",
                                                                 {{"quantity", "", ""},
                                                                  {"artefact", "", ""},
                                                                  {"position", "", ""},
                                                                  {"U / mm", "number", ""},
                                                                  {"limits / mm", "number", ""},
                                                                  {"U of the limit", "number", ""},
                                                                  {"u of a later measurement / mm", "number", ""}},
                                                                 rows));
  return page(content.title, body);
}

}  // namespace fringecal::reports
