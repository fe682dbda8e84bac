#include "hw/virtual/loopback_interface.h"

#include "core/error.h"

#include <arpa/inet.h>
#include <dlfcn.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>

namespace {

// The entry is never freed: the C library gives its list back as one block and does not look at entries added behind.
thread_local sockaddr_in listed_address, listed_mask, listed_broadcast;
thread_local ifaddrs listed_interface;
thread_local bool listed = false;

}  // namespace

// Takes the place of the C library's function in this program and in the libraries that it loads.
extern "C" __attribute__((visibility("default"))) int getifaddrs(ifaddrs** list) noexcept {
  using Function = int (*)(ifaddrs**);
  static const auto original = reinterpret_cast<Function>(dlsym(RTLD_NEXT, "getifaddrs"));
  const int result = original ? original(list) : -1;
  if (result != 0 || !listed) return result;
  ifaddrs** end = list;
  while (*end) end = &(*end)->ifa_next;
  *end = &listed_interface;
  return result;
}

namespace fringecal::virt {

ListedLoopback::ListedLoopback(const std::string& address) {
  const auto fill = [](sockaddr_in& place, std::uint32_t host) {
    place = {};
    place.sin_family = AF_INET;
    place.sin_addr.s_addr = htonl(host);
  };
  in_addr parsed{};
  require(inet_pton(AF_INET, address.c_str(), &parsed) == 1 && ntohl(parsed.s_addr) >> 24 == IN_LOOPBACKNET,
          "a loopback address is in 127.0.0.0/8");
  static char name[] = "lo";
  fill(listed_address, ntohl(parsed.s_addr));
  fill(listed_mask, 0xFF000000u);
  fill(listed_broadcast, ntohl(parsed.s_addr));  // its own: no second socket for broadcasts
  listed_interface = {};
  listed_interface.ifa_name = name;
  listed_interface.ifa_flags = IFF_UP | IFF_RUNNING | IFF_LOOPBACK;
  listed_interface.ifa_addr = reinterpret_cast<sockaddr*>(&listed_address);
  listed_interface.ifa_netmask = reinterpret_cast<sockaddr*>(&listed_mask);
  listed_interface.ifa_broadaddr = reinterpret_cast<sockaddr*>(&listed_broadcast);
  listed = true;
}

ListedLoopback::~ListedLoopback() { listed = false; }

}  // namespace fringecal::virt
