#include "hw/gvsp_filter.h"

#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <charconv>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>

namespace fringecal::hw {
namespace {

// The filter sees a datagram from its UDP header on.
constexpr std::uint32_t kUdp = 8, kIpAndUdp = 28, kHeader = 8, kExtendedHeader = 20;
constexpr std::uint32_t kKind = kUdp + 4, kNumber = kUdp + 4, kExtendedNumber = kUdp + 16;
constexpr std::uint32_t kExtended = 0x80, kKindMask = 0x7F, kNumberMask = 0xFFFFFF;
constexpr std::uint32_t kLeader = 1, kData = 3;

std::optional<int> socket_on(int port) {
  std::error_code error;
  for (std::filesystem::directory_iterator it("/proc/self/fd", error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename();
    int fd = -1, type = 0;
    if (std::from_chars(name.data(), name.data() + name.size(), fd).ec != std::errc()) continue;
    sockaddr_in address{};
    socklen_t size = sizeof address, type_size = sizeof type;
    if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0 && address.sin_family == AF_INET &&
        ntohs(address.sin_port) == port && getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_size) == 0 &&
        type == SOCK_DGRAM) {
      return fd;
    }
  }
  return std::nullopt;
}

}  // namespace

bool filter_stream(int port, std::uint32_t payload_bytes, std::uint32_t packet_bytes) {
  if (packet_bytes <= kIpAndUdp + kExtendedHeader) return false;
  const auto most = [&](std::uint32_t header) {
    const std::uint32_t room = packet_bytes - kIpAndUdp - header;
    return payload_bytes / room + (payload_bytes % room != 0);  // eq. 2
  };
  // Jumps count from the instruction behind them.
  std::array<sock_filter, 24> code = {{
      BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0), BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kUdp + kHeader, 0, 21),  // eq. 1
      BPF_STMT(BPF_LD | BPF_B | BPF_ABS, kKind), BPF_STMT(BPF_ALU | BPF_AND | BPF_K, kKindMask),
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kLeader, 0, 18), BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, kData, 17, 0),
      BPF_STMT(BPF_MISC | BPF_TAX, 0),  // the kind
      BPF_STMT(BPF_LD | BPF_B | BPF_ABS, kKind), BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, kExtended, 6, 0),
      // 16-bit ids
      BPF_STMT(BPF_MISC | BPF_TXA, 0), BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kData, 0, 11),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kNumber), BPF_STMT(BPF_ALU | BPF_AND | BPF_K, kNumberMask),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 9, 0), BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, most(kHeader), 8, 7),
      // extended ids
      BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0),
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kUdp + kExtendedHeader, 0, 6),  // eq. 1
      BPF_STMT(BPF_MISC | BPF_TXA, 0), BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kData, 0, 3),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kExtendedNumber), BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 2, 0),
      BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, most(kExtendedHeader), 1, 0),
      BPF_STMT(BPF_RET | BPF_K, 0xFFFFFFFF),  // all of it
      BPF_STMT(BPF_RET | BPF_K, 0),           // nothing
  }};
  const sock_fprog program{.len = code.size(), .filter = code.data()};
  const auto fd = socket_on(port);
  return fd && setsockopt(*fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0;
}

}  // namespace fringecal::hw
