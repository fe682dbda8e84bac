// Every reader of files and replies from outside, with sound examples to damage.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace fringecal::test {

struct Reader {
  std::string name;
  std::vector<std::string> examples;  // bytes that it takes
  /// Reads; what it may throw at unusable input is caught inside, anything else comes out.
  std::function<void(std::string_view bytes)> read;
  /// The same without the catch.
  std::function<void(std::string_view bytes)> read_sound;
  bool is_device = false;  // a reading takes tens of milliseconds: time limits of a link pass
};

/// Of a file that is written anew for each piece; its name is the reader's.
Reader of_file(const std::filesystem::path& file, std::vector<std::string> examples,
               const std::function<void(const std::filesystem::path&)>& read);

/// folder: for readers that take a file, not bytes.
std::vector<Reader> readers(const std::filesystem::path& folder);

/// `bytes` damaged in one to four places: bits, bytes, stretches removed, repeated or moved, the end cut, numbers made
/// extreme. The same number gives the same damage.
std::string damaged(std::string bytes, std::uint64_t number);

}  // namespace fringecal::test
