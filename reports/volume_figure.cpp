// The measuring volume with the positions of the features.
#include "reports/certificate_figures.h"
#include "reports/number.h"
#include "reports/svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>

namespace fringecal::reports {
namespace {

constexpr double kWidth = 640, kGap = 44, kFrame = 14, kTop = 20, kFoot = 30, kLegendRow = 17;
constexpr double kNear = 0.03;  // of the largest extent: features closer than this share one label

/// Features of one artefact at (nearly) one place.
struct Place {
  std::string artefact;
  int part = 0;
  Eigen::Vector3d at_mm, low_mm, high_mm;
  int first = 0, last = 0;  // numbers of the captures
  bool has_box = false;
};

/// "ball_bar-03" -> 4, as positions are numbered in the table of results; 0 where the name ends otherwise.
int position_of(const std::string& capture) {
  const auto dash = capture.rfind('-');
  int number = -1;
  if (dash != std::string::npos) std::from_chars(capture.data() + dash + 1, capture.data() + capture.size(), number);
  return number + 1;
}

std::vector<Place> places_of(const metrology::Verification& v, double near_mm) {
  std::vector<Place> out;
  for (const auto& f : v.features) {
    const int number = position_of(f.capture);
    const auto same = std::find_if(out.begin(), out.end(), [&](const Place& p) {
      return p.artefact == f.artefact && p.part == f.part && (p.at_mm - f.place_mm).norm() < near_mm;
    });
    if (same != out.end()) {
      same->first = std::min(same->first, number);
      same->last = std::max(same->last, number);
      continue;
    }
    const bool has_box = !f.cloud.empty();
    out.push_back({f.artefact, f.part, f.place_mm, has_box ? f.low_mm : f.place_mm, has_box ? f.high_mm : f.place_mm,
                   number, number, has_box});
  }
  return out;
}

/// The largest of 1, 2, 5 times a power of ten that is at most x.
double round_length(double x) {
  const double power = std::pow(10, std::floor(std::log10(x)));
  return x >= 5 * power ? 5 * power : x >= 2 * power ? 2 * power : power;
}

svg::Mark mark_of(std::size_t artefact) {
  constexpr svg::Mark kMarks[] = {svg::Mark::disc,    svg::Mark::square, svg::Mark::triangle,
                                  svg::Mark::diamond, svg::Mark::cross,  svg::Mark::circle};
  return kMarks[artefact % std::size(kMarks)];
}

class Drawing {
 public:
  Drawing(std::vector<Place> places, const Eigen::Vector3d& low, const Eigen::Vector3d& high)
      : places_(std::move(places)), low_(low), high_(high) {
    for (const auto& p : places_) {
      if (std::find(artefacts_.begin(), artefacts_.end(), p.artefact) == artefacts_.end()) {
        artefacts_.push_back(p.artefact);
      }
    }
    const Eigen::Vector3d size = high_ - low_;
    scale_ = std::min((kWidth - kGap - 4 * kFrame) / (2 * size.x()), 230 / std::max(size.y(), size.z()));
    width_ = size.x() * scale_ + 2 * kFrame;
    height_ = std::max(size.y(), size.z()) * scale_ + 2 * kFrame;
  }

  std::string draw() {
    const std::size_t per_row = 3;
    const std::size_t legend_rows = (artefacts_.size() + per_row - 1) / per_row;
    const double legend = kLegendRow * static_cast<double>(legend_rows);
    const double total = kTop + height_ + kFoot + legend;
    std::string out = svg::begin("volume", kWidth, total);
    const double left = (kWidth - 2 * width_ - kGap) / 2, right = left + width_ + kGap;
    out += view(left, 1, "Y") + view(right, 2, "Z");
    const double bar = round_length(0.4 * (high_.x() - low_.x())), foot = kTop + height_ + 12;
    bar_mm_ = fixed(bar, bar < 1 ? 2 : 0);
    out += svg::line(left, foot, left + bar * scale_, foot, svg::kInk, 1.6) +
           svg::line(left, foot - 3, left, foot + 3, svg::kInk, 1.2) +
           svg::line(left + bar * scale_, foot - 3, left + bar * scale_, foot + 3, svg::kInk, 1.2) +
           svg::words(left + bar * scale_ + 6, foot + 3.6, "start", bar_mm_ + "\u00a0mm");
    for (std::size_t k = 0; k < artefacts_.size(); ++k) {
      const std::size_t row = k / per_row;
      const double x = 10 + static_cast<double>(k % per_row) * kWidth / per_row;
      const double y = kTop + height_ + kFoot + kLegendRow * static_cast<double>(row) + 6;
      out += svg::mark(mark_of(k), x, y) + svg::words(x + 9, y + 3.6, "start", artefacts_[k]);
    }
    return out + svg::kEnd;
  }

  std::string numbers() const {
    std::string out = bar_mm_ + " mm";
    for (const auto& p : places_) out += fmt::format(" {} {}", p.first, p.last);
    for (const auto& name : artefacts_) out += " " + name;
    return out;
  }

 private:
  /// X to the right, the axis `up` upwards.
  std::string view(double left, int up, const char* name) {
    const double foot = kTop + height_;
    const auto x_of = [&](const Eigen::Vector3d& p) { return left + kFrame + (p.x() - low_.x()) * scale_; };
    const auto y_of = [&](const Eigen::Vector3d& p) { return foot - kFrame - (p[up] - low_[up]) * scale_; };
    std::string out = svg::box(left, kTop, width_, height_, "none", svg::kQuiet, 0.8) +
                      svg::words(left, kTop - 6, "start", name) + svg::words(left + width_, foot + 15, "end", "X");
    for (const auto& p : places_) {
      if (!p.has_box) continue;
      out += svg::box(x_of(p.low_mm), y_of(p.high_mm), x_of(p.high_mm) - x_of(p.low_mm),
                      y_of(p.low_mm) - y_of(p.high_mm), "none", svg::kQuiet, 0.7);
    }
    for (std::size_t i = 1; i < places_.size(); ++i) {  // the spheres of a ball bar or a plate
      const auto &a = places_[i - 1], &b = places_[i];
      if (b.part == a.part + 1 && a.artefact == b.artefact && a.first == b.first) {
        out += svg::line(x_of(a.at_mm), y_of(a.at_mm), x_of(b.at_mm), y_of(b.at_mm), svg::kBlue, 1);
      }
    }
    std::vector<std::pair<double, double>> labels;
    for (const auto& p : places_) {
      const auto kind =
          static_cast<std::size_t>(std::find(artefacts_.begin(), artefacts_.end(), p.artefact) - artefacts_.begin());
      const double x = x_of(p.at_mm), y = y_of(p.at_mm);
      out += svg::mark(mark_of(kind), x, y);
      if (p.part > 0) continue;  // the first sphere of a bar has the number
      const double label_x = x + 6.5, label_y = y - 3;
      const bool hidden = std::any_of(labels.begin(), labels.end(), [&](const auto& l) {
        return std::abs(l.first - label_x) < 12 && std::abs(l.second - label_y) < 8;
      });
      if (hidden) continue;  // behind another one in this view
      labels.emplace_back(label_x, label_y);
      const std::string number = p.first == p.last ? fmt::format("{}", p.first) : fmt::format("{}–{}", p.first, p.last);
      out += svg::words(label_x, label_y, "start", number, 9);
    }
    return out;
  }

  std::vector<Place> places_;
  Eigen::Vector3d low_, high_;
  std::vector<std::string> artefacts_;
  std::string bar_mm_;
  double scale_ = 1, width_ = 0, height_ = 0;
};

}  // namespace

std::vector<CertificateFigure> volume_figures(const Certificate& c, const Catalogue& words) {
  std::vector<CertificateFigure> out;
  for (const auto& record : c.records) {
    const auto& features = record.verification.features;
    if (features.empty()) continue;
    Eigen::Vector3d low = features.front().place_mm, high = low;
    for (const auto& f : features) {
      low = low.cwiseMin(f.place_mm);
      high = high.cwiseMax(f.place_mm);
      if (f.cloud.empty()) continue;
      low = low.cwiseMin(f.low_mm);
      high = high.cwiseMax(f.high_mm);
    }
    const double extent = (high - low).maxCoeff();
    if (!(extent > 0)) continue;  // one point is no volume
    high = high.cwiseMax(low + Eigen::Vector3d::Constant(0.02 * extent));
    Drawing drawing(places_of(record.verification, kNear * extent), low, high);
    const std::string picture = drawing.draw();
    out.push_back({"volume", Markup::trusted(picture), words("figures.volume"), drawing.numbers()});
  }
  return out;
}

std::vector<CertificateFigure> certificate_figures(const Certificate& c, const Catalogue& words) {
  std::vector<CertificateFigure> out = volume_figures(c, words);
  for (auto& figure : map_figures(c, words)) out.push_back(std::move(figure));
  for (auto& figure : history_figures(c, words)) out.push_back(std::move(figure));
  return out;
}

}  // namespace fringecal::reports
