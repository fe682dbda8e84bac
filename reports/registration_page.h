// A registration on one page: what the views have in common, how well they agree, and, where the true surface is known, the
// deviations from it as maps of four sides.
#pragma once

#include "core/image.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

struct RegistrationPage {
  struct View {
    std::string name, points, spheres, grazing;
  };
  struct Pair {
    std::string a, b, points, mean_um, sd_um, noise_um;
  };
  struct Map {
    std::string name;
    Image<float> mean_mm;
    double left_mm = 0, top_mm = 0, cell_mm = 1;
    std::string sd_um;  // of its cells
  };
  struct Truth {
    std::string source;                                        // what the cloud was held against
    std::vector<std::pair<std::string, std::string>> figures;  // "standard deviation", "29.4 µm"
    std::vector<Map> maps;
  };
  std::string title;
  std::vector<std::pair<std::string, std::string>> figures;
  std::vector<View> views;
  std::vector<Pair> pairs;
  std::optional<Truth> truth;
};

/// HTML.
std::string registration_page(const RegistrationPage& content);

}  // namespace fringecal::reports
