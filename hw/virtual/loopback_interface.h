// Lets ArvGvFakeCamera live on any loopback address. It looks its address up in the system's list of interfaces, where
// of 127.0.0.0/8 only 127.0.0.1 stands, though Linux takes packets for all of them. While an object of this class
// lives, this thread sees one more interface in that list (getifaddrs), with the address given.
#pragma once

#include <string>

namespace fringecal::virt {

class ListedLoopback {
 public:
  /// Throws std::logic_error where the address is not in 127.0.0.0/8.
  explicit ListedLoopback(const std::string& address);
  ~ListedLoopback();
  ListedLoopback(const ListedLoopback&) = delete;
  ListedLoopback& operator=(const ListedLoopback&) = delete;
};

}  // namespace fringecal::virt
