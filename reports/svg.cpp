#include "reports/svg.h"

#include "reports/html.h"

#include <fmt/format.h>

namespace fringecal::reports::svg {

std::string begin(const char* kind, double width, double height) {
  return fmt::format(
      "<svg class=\"{0}\" role=\"img\" xmlns=\"http://www.w3.org/2000/svg\" "
      "xmlns:xlink=\"http://www.w3.org/1999/xlink\" viewBox=\"0 0 {1:.0f} {2:.0f}\" width=\"{1:.0f}\" "
      "height=\"{2:.0f}\" font-family=\"Liberation Sans, Arial, sans-serif\">",
      kind, width, height);
}

std::string line(double x1, double y1, double x2, double y2, const char* colour, double width, const char* dashes) {
  return fmt::format(
      "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"{}\" stroke-width=\"{}\"{}/>", x1, y1, x2,
      y2, colour, width, dashes == nullptr ? "" : fmt::format(" stroke-dasharray=\"{}\"", dashes));
}

std::string words(double x, double y, const char* anchor, const std::string& words, double size) {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"{}\" fill=\"{}\">{}</text>", x, y,
                     anchor, size, kInk, escape(words));
}

std::string box(double x, double y, double width, double height, const char* fill, const char* stroke,
                double stroke_width) {
  return fmt::format(
      "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"{}\" stroke=\"{}\" "
      "stroke-width=\"{}\"/>",
      x, y, width, height, fill, stroke, stroke_width);
}

std::string mark(Mark mark, double x, double y, double r) {
  const auto path = [&](const std::string& way) {
    return fmt::format("<path d=\"{}\" fill=\"#ffffff\" stroke=\"{}\" stroke-width=\"1.3\"/>", way, kBlue);
  };
  switch (mark) {
    case Mark::disc:
      return fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\" fill=\"{}\"/>", x, y, r, kBlue);
    case Mark::circle:
      return fmt::format(
          "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\" fill=\"#ffffff\" stroke=\"{}\" stroke-width=\"1.3\"/>", x, y, r,
          kBlue);
    case Mark::square:
      return box(x - r, y - r, 2 * r, 2 * r, "#ffffff", kBlue, 1.3);
    case Mark::triangle:
      return path(fmt::format("M{:.1f} {:.1f}l{:.1f} {:.1f}h{:.1f}z", x, y - 1.2 * r, 1.1 * r, 2 * r, -2.2 * r));
    case Mark::diamond:
      return path(fmt::format("M{:.1f} {:.1f}l{:.1f} {:.1f}l{:.1f} {:.1f}l{:.1f} {:.1f}z", x, y - 1.3 * r, 1.3 * r,
                              1.3 * r, -1.3 * r, 1.3 * r, -1.3 * r, -1.3 * r));
    case Mark::cross:
      return line(x - r, y - r, x + r, y + r, kBlue, 1.5) + line(x - r, y + r, x + r, y - r, kBlue, 1.5);
  }
  return "";
}

}  // namespace fringecal::reports::svg
