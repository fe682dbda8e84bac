#include "core/provenance.h"

#include "core/file.h"

namespace fringecal {

const char* const kProgramVersion = FRINGECAL_VERSION;

Provenance provenance_now() { return {.version = kProgramVersion, .date = utc_now(), .inputs = {}}; }

Value to_value(const Provenance& provenance) {
  Value inputs = Value::object();
  for (const auto& [name, sha256] : provenance.inputs) inputs.set(name, sha256);
  return Value::object()
      .set("program", provenance.program)
      .set("version", provenance.version)
      .set("date", provenance.date)
      .set("inputs_sha256", inputs);
}

}  // namespace fringecal
