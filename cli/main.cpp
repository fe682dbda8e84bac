// fringecal: the command. Exceptions of the library become one sentence and an exit code here, and nowhere else.
//   0 done; 1 a defect of the program itself; 2 the input cannot be used; 3 the machine failed, or a device;
//   130 stopped by Ctrl-C, safely, and to be continued by the same command.
#include "cli/commands.h"
#include "core/error.h"
#include "core/provenance.h"
#include "hw/camera.h"
#include "hw/capture_sequence.h"
#include "hw/plc.h"

#include <sys/stat.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <new>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace {

/// Nothing that is written can be written by everybody, whatever the umask of the shell; and a word to root, whose files
/// the operator cannot continue.
void be_careful(int argc, char** argv) {
  ::umask(::umask(S_IWOTH) | S_IWOTH);
  const std::string command = argc > 1 ? argv[1] : "";
  const bool only_prints = command.empty() || command.front() == '-' || command == "man" || command == "completion";
  if (::geteuid() == 0 && !only_prints && std::getenv("FRINGECAL_ROOT_IS_MEANT") == nullptr) {
    std::fputs(
        "fringecal: warning: running as root; no command needs it, and other users cannot continue what root began. "
        "Run it as the operator, who needs access to the camera's network and to the PLC's line only (or set "
        "FRINGECAL_ROOT_IS_MEANT).\n",
        stderr);
    ::setenv("FRINGECAL_ROOT_IS_MEANT", "1", 1);  // said once: the programs started from here need not say it again
  }
}

/// A first word that is no command gets an answer with the command it resembles most.
void refuse_unknown(const CLI::App& app, int argc, char** argv) {
  const std::string word = argc > 1 ? argv[1] : "";
  if (word.empty() || word.front() == '-') return;
  // Levenshtein's distance by rows.
  const auto distance = [](const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
      std::size_t diagonal = row[0]++;
      for (std::size_t j = 0; j < b.size(); ++j) {
        diagonal = std::exchange(row[j + 1], std::min({diagonal + (a[i] != b[j]), row[j] + 1, row[j + 1] + 1}));
      }
    }
    return row.back();
  };
  std::string nearest;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    const std::string& name = command->get_name();
    if (name == word) return;
    if (nearest.empty() || distance(word, name) < distance(word, nearest)) nearest = name;
  }
  const bool close = distance(word, nearest) <= 3;
  throw fringecal::InputError("'" + word + "' is not a command" + (close ? "; did you mean '" + nearest + "'?" : "") +
                              " (fringecal --help lists them)");
}

}  // namespace

int main(int argc, char** argv) {
  using namespace fringecal;
  be_careful(argc, argv);
  CLI::App app{"fringecal - commissions, verifies and certifies fringe-projection 3D scanners", "fringecal"};
  app.set_version_flag("--version", std::string("fringecal ") + kProgramVersion);
  app.require_subcommand(1);
  cli::add_commission(app);
  cli::add_verify(app);
  cli::add_plan(app);
  cli::add_history(app);
  cli::add_align(app);
  cli::add_calibrate(app);
  cli::add_compare(app);
  cli::add_uncertainty(app);
  cli::add_export(app);
  cli::add_import_lenses(app);
  cli::add_measure(app);
  cli::add_register(app);
  cli::add_fit(app);
  cli::add_certify(app);
  cli::add_check(app);
  cli::add_report(app);
  cli::add_dcc(app);
  cli::add_find(app);
  cli::add_check_fits(app);
  cli::add_import(app);
  cli::add_decode(app);
  cli::add_capture(app);
  cli::add_live(app);
  cli::add_devices(app);
  cli::add_virtual(app);
  cli::add_render(app);
  cli::add_serve(app);
  cli::add_manual(app);
  app.failure_message([](const CLI::App* program, const CLI::Error& e) {
    std::string called = "fringecal";
    for (const CLI::App* command : program->get_subcommands()) called += " " + command->get_name();
    return called + ": " + e.what() + "; " + called + " --help tells more\n";
  });
  try {
    refuse_unknown(app, argc, argv);
    app.parse(argc, argv);
    return 0;
  } catch (const CLI::ParseError& e) {
    const int code = app.exit(e);
    return code == 0 ? 0 : 2;
  } catch (const InputError& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 2;
  } catch (const EnvironmentError& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 3;
  } catch (const hw::CaptureStopped& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 130;
  } catch (const hw::CameraLost& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 3;
  } catch (const hw::FrameLost& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 3;
  } catch (const hw::PlcLost& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 3;
  } catch (const hw::PlcFault& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 3;
  } catch (const std::filesystem::filesystem_error& e) {
    std::fprintf(stderr, "fringecal: %s\n", e.what());
    return 3;
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "fringecal: not enough memory for this input; close other programs or use a smaller one\n");
    return 3;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "fringecal: a defect of the program: %s; please report it with the command you ran\n",
                 e.what());
    return 1;
  }
}
