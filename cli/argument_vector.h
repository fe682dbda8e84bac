// The words of a command as the system wants them to start a program: no shell is ever involved.
#pragma once

#include <string>
#include <vector>

namespace fringecal::cli {

/// Pointers into `words`, and the null that ends them.
inline std::vector<char*> argument_vector(std::vector<std::string>& words) {
  std::vector<char*> out;
  out.reserve(words.size() + 1);
  for (std::string& word : words) out.push_back(word.data());
  out.push_back(nullptr);
  return out;
}

}  // namespace fringecal::cli
