// FRINGECAL_LONG=1 in the environment: tests whose evidence grows with their size run at full size.
#pragma once

#include <cstdlib>
#include <string_view>

namespace fringecal::test {

inline bool long_tests() {
  const char* value = std::getenv("FRINGECAL_LONG");
  return value && std::string_view(value) == "1";
}

}  // namespace fringecal::test
