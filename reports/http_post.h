// One POST over HTTP, bounded in time and size: the only piece of the program that speaks to a server outside the
// laboratory, and only where an address is given.
#pragma once

#include <chrono>
#include <string>

namespace fringecal::reports {

struct HttpPost {
  std::string url;  // http://host[:port][/path] or https://...
  std::string content_type, accept;
  std::string body;
  std::chrono::seconds together{20};  // from the look-up of the name to the last byte
  std::size_t largest_answer = 200'000;
};

/// The body of an answer with status 200 and the content type that was asked for. No redirect is followed, no proxy asked.
/// InputError: the address is none. EnvironmentError with the address: everything else.
std::string http_post(const HttpPost& post);

}  // namespace fringecal::reports
