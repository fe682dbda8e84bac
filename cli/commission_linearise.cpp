// Step 2 of a commissioning: the phase-linearisation table, from stacks of the flat board on the aligned instrument.
#include "calib/linearise.h"
#include "cli/behind.h"
#include "cli/commission_steps.h"
#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"

#include <fmt/format.h>

namespace fringecal::cli {
namespace {

constexpr const char* kFile = "linearisation.json";
constexpr const char* kSchema = "fringecal.linearisation";

}  // namespace

void linearise_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress) {
  if (session.has(kFile)) {
    progress.done(Weights::flat * kFlatStacks, true);
    return;
  }
  const Stopwatch watch;
  calib::LinearisationFit fit(CodeAxis::x);
  Behind behind;
  for (int i = 0; i < kFlatStacks; ++i) {
    const std::string name = flat_stack_name(i);
    progress.start(fmt::format("linearising the phase, flat stack {} of {}", i + 1, kFlatStacks));
    behind.run([&, name, capture = instrument.capture(name, "alignment")] {
      const auto added = fit.add(capture, name, sha256_of_file(session.path(name) / "capture.json"));
      if (!added) session.refuse_capture(name, added.error().sentence);
    });
    progress.done(Weights::flat);
  }
  behind.finish();
  const auto table = fit.table();
  double largest = 0;
  for (const auto& z : table.ripple_rad) largest = std::max(largest, std::abs(z));
  session.store(kFile, Value::object()
                           .set("schema", kSchema)
                           .set("schema_version", 1)
                           .set("table", model::to_value(table))
                           .set("left_over_mrad", 1e3 * fit.left_over_rad())
                           .set("duration_s", watch.seconds()));
  progress.finish_step(
      fmt::format("phase linearised: up to {:.1f} mrad of {} cycles per period over the field; from "
                  "stack to stack {:.1f} mrad of one and {:.1f} mrad of two cycles",
                  1e3 * largest, table.phase_steps, 1e3 * table.sd_offset, 1e3 * table.sd_conjugate));
}

std::string flat_stack_name(int number) { return fmt::format("linearisation/stack-{}", number); }

model::PhaseLinearisation load_linearisation(const CommissionSession& session) {
  Fields f(session.load(kFile), session.path(kFile).string());
  f.expect_schema(kSchema, 1);
  auto table = model::phase_linearisation_from(f.table("table"));
  f.number("left_over_mrad");
  f.number("duration_s");
  f.finish();
  return table;
}

}  // namespace fringecal::cli
