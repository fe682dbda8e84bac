#include "cli/commands.h"

#include <CLI/CLI.hpp>

namespace fringecal::cli {

void add_render(CLI::App&) {}

}  // namespace fringecal::cli
