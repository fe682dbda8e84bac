// fringecal: the command. Exceptions of the library become one sentence and an exit code here, and nowhere else.
//   0 done; 1 a defect of the program itself; 2 the input cannot be used; 3 the machine failed, or a device;
//   130 stopped by Ctrl-C, safely, and to be continued by the same command.
#include "cli/commands.h"
#include "core/error.h"
#include "core/provenance.h"
#include "hw/camera.h"
#include "hw/capture_sequence.h"
#include "hw/plc.h"

#include <CLI/CLI.hpp>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <new>

int main(int argc, char** argv) {
  using namespace fringecal;
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
  try {
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
