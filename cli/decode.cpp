#include "cli/commands.h"

#include <CLI/CLI.hpp>

namespace fringecal::cli {

void add_decode(CLI::App&) {}

}  // namespace fringecal::cli
