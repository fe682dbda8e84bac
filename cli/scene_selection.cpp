#include "cli/scene_selection.h"

#include "core/error.h"
#include "hw/plc_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

namespace fringecal::cli {

hw::VirtualSelection scene_selection(const std::string& words) {
  std::istringstream in(words);
  std::string name, rest;
  int pose = 0;
  in >> name;
  const bool numbered = static_cast<bool>(in >> pose);
  const auto found = std::find(hw::kSceneNames.begin(), hw::kSceneNames.end(), name);
  if (found == hw::kSceneNames.end() || pose < 0 || pose > 65535 || (!numbered && !in.eof()) || in >> rest) {
    throw InputError(fmt::format(
        "--scene '{}': give alignment, calibration, plane, spheres or cylinder, and a number: \"plane 0\"", words));
  }
  hw::VirtualSelection selection;
  selection.scene = static_cast<std::uint16_t>(found - hw::kSceneNames.begin());
  selection.pose = static_cast<std::uint16_t>(pose);
  return selection;
}

}  // namespace fringecal::cli
