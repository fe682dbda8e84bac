#include "cli/serve/pages.h"

namespace fringecal::cli::serve {

std::optional<std::filesystem::path> three_file(const std::string& path) {
  constexpr const char* kRoot = "/usr/share/javascript/three";
  constexpr std::string_view kModules[] = {"/build/three.module.js", "/examples/jsm/controls/OrbitControls.js"};
  for (const auto& module : kModules) {
    if (path == "/three" + std::string(module)) return kRoot + std::string(module);
  }
  return std::nullopt;
}

}  // namespace fringecal::cli::serve
