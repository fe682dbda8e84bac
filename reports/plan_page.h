// A verification plan on one page, before any capture: where the artefacts stand in the volume (from the camera's side, X
// and Y, and from the side, X and Z) with what the camera sees and the coded field at three heights, and what each
// quantity's uncertainty will be.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace fringecal::reports {

/// A line through points of world, mm; closed outlines repeat their first point. A break is a point of NaN.
struct SpaceLine {
  std::vector<double> x, y, z;
};

struct PlanPageSeries {
  std::string label;             // "ball_bar: bar150, 7 positions"
  std::vector<SpaceLine> lines;  // outlines of its artefacts at all their places
};

struct PlanPageRow {
  std::string symbol, artefact, position, U_mm, limits, share, u_later_mm;
};

struct PlanPage {
  std::string title, scanner, assumption;
  std::vector<PlanPageSeries> series;
  std::vector<SpaceLine> camera_field, coded_field;  // at each height
  std::vector<PlanPageRow> rows;
  std::vector<std::string> problems;
};

/// HTML. Throws as draw() of plot.h.
std::string plan_page(const PlanPage& content);

}  // namespace fringecal::reports
