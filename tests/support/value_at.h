// Numbers of a document that a command printed.
#pragma once

#include "core/value.h"

#include <initializer_list>
#include <stdexcept>
#include <string>

namespace fringecal::test {

/// Of the key at the end of the path, real or integer. Throws where a key is missing.
inline double number_at(const Value& tree, std::initializer_list<const char*> path) {
  const Value* v = &tree;
  for (const char* key : path) {
    v = v->find(key);
    if (!v) throw std::runtime_error(std::string("no key ") + key);
  }
  return v->if_real() ? *v->if_real() : static_cast<double>(*v->if_integer());
}

}  // namespace fringecal::test
