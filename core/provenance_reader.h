// Reading a Provenance back: apart from core/provenance.h, which everything includes and which needs no reader.
#pragma once

#include "core/fields.h"
#include "core/provenance.h"

namespace fringecal {

/// Throws InputError: a key that is missing or unknown, a hash that is not a text.
Provenance provenance_from(Fields fields);

}  // namespace fringecal
