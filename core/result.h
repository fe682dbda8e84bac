// Result<T>: the answer, or the one sentence that says why the data cannot give it.
//
// Three kinds of failure, three ways to say it:
//   the caller broke a contract      -> std::logic_error (see require())
//   the world failed (file, device)  -> InputError / EnvironmentError (core/error.h)
//   the data cannot answer           -> Result<T>, here: a value of the ordinary flow of a program
#pragma once

#include <tl/expected.hpp>

#include <string>
#include <utility>

namespace fringecal {

/// Why no result can be given: one sentence with the numbers, their units, and what would help.
struct Unanswerable {
  std::string sentence;
};

template <class T>
using Result = tl::expected<T, Unanswerable>;

inline tl::unexpected<Unanswerable> unanswerable(std::string sentence) {
  return tl::unexpected<Unanswerable>(Unanswerable{std::move(sentence)});
}

}  // namespace fringecal
