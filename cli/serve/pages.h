// The front end: files of cli/serve/web that are part of the program, and the parts of three.js that Debian ships.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace fringecal::cli::serve {

struct Page {
  std::string_view path, type, content;
};

/// Made from cli/serve/web when the program is built.
std::span<const Page> pages();

/// Paths below /three/: the modules of libjs-three that the cloud page loads; nothing for any other.
std::optional<std::filesystem::path> three_file(const std::string& path);

}  // namespace fringecal::cli::serve
