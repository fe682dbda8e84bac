#include "reports/registration_page.h"

#include "reports/html.h"
#include "reports/picture.h"

namespace fringecal::reports {
namespace {

Markup figures_table(const std::vector<std::pair<std::string, std::string>>& figures) {
  std::vector<std::vector<Markup>> rows;
  rows.reserve(figures.size());
  for (const auto& [name, value] : figures) rows.push_back({text(name), text(value)});
  return table("plain", {{"", "", ""}, {"", "number", ""}}, rows);
}

Markup truth_section(const RegistrationPage::Truth& truth) {
  Markup body = element("p", text(truth.source)) + figures_table(truth.figures);
  for (const auto& map : truth.maps) {
    const HeatMapOptions options{.label = "mean deviation, µm",
                                 .scale = 1000,
                                 .x = {.first = map.left_mm, .step = map.cell_mm},
                                 .y = {.first = map.top_mm, .step = -map.cell_mm}};
    body += figure("half", heat_map(map.mean_mm, options),
                   "Seen " + map.name + ", mm; standard deviation of the cells " + map.sd_um + ".");
  }
  return section("truth", "Deviations from the true surface", body);
}

}  // namespace

std::string registration_page(const RegistrationPage& content) {
  Markup body = element("h1", text(content.title)) + figures_table(content.figures);
  if (content.truth) body += truth_section(*content.truth);
  std::vector<std::vector<Markup>> rows;
  for (const auto& v : content.views) rows.push_back({text(v.name), text(v.points), text(v.spheres), text(v.grazing)});
  body += section("views", "Views",
                  table("plain",
                        {{"view", "", ""},
                         {"points", "number", ""},
                         {"reference spheres", "number", ""},
                         {"grazing points, not used to join", "number", ""}},
                        rows));
  rows.clear();
  for (const auto& p : content.pairs) {
    rows.push_back({text(p.a), text(p.b), text(p.points), text(p.mean_um), text(p.sd_um), text(p.noise_um)});
  }
  body += section("pairs", "Overlaps: points of the first view against the surface of the second",
                  table("plain",
                        {{"view", "", ""},
                         {"against", "", ""},
                         {"points", "number", ""},
                         {"mean / µm", "number", ""},
                         {"standard deviation / µm", "number", ""},
                         {"of it noise of the points / µm", "number", ""}},
                        rows));
  return page(content.title, body);
}

}  // namespace fringecal::reports
