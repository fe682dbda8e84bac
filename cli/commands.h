// The commands of the program, one file each: parse -> load -> one library call -> write. No mathematics.
#pragma once

namespace CLI {
class App;
}

namespace fringecal::cli {

void add_import(CLI::App& app);
void add_decode(CLI::App& app);
void add_calibrate(CLI::App& app);
void add_align(CLI::App& app);
void add_compare(CLI::App& app);
void add_measure(CLI::App& app);
void add_fit(CLI::App& app);
void add_find(CLI::App& app);
void add_check_fits(CLI::App& app);
void add_render(CLI::App& app);
void add_commission(CLI::App& app);
void add_capture(CLI::App& app);
void add_devices(CLI::App& app);
void add_live(CLI::App& app);
void add_virtual(CLI::App& app);
void add_plan(CLI::App& app);
void add_verify(CLI::App& app);
void add_register(CLI::App& app);
void add_history(CLI::App& app);
void add_certify(CLI::App& app);
void add_check(CLI::App& app);
void add_dcc(CLI::App& app);
void add_report(CLI::App& app);
void add_serve(CLI::App& app);

}  // namespace fringecal::cli
