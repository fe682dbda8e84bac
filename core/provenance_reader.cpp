#include "core/provenance_reader.h"

#include <fmt/format.h>

namespace fringecal {

Provenance provenance_from(Fields fields) {
  Provenance out;
  out.program = fields.text("program");
  out.version = fields.text("version");
  out.date = fields.text("date");
  const Value inputs = fields.raw("inputs_sha256");
  if (const auto* object = inputs.if_object()) {
    for (const auto& [name, sha256] : *object) {
      const auto* text = sha256.if_text();
      if (text == nullptr) fields.complain(fmt::format("inputs_sha256: {} is not a text", name));
      out.inputs.emplace_back(name, *text);
    }
  }
  fields.finish();
  return out;
}

}  // namespace fringecal
