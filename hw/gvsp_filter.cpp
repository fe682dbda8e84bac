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
#include <tuple>
#include <vector>

namespace fringecal::hw {
namespace {

// The filter sees a datagram from its UDP header on.
constexpr std::uint32_t kUdp = 8, kIpAndUdp = 28, kHeader = 8, kExtendedHeader = 20;
constexpr std::uint32_t kKind = kUdp + 4, kNumber = kUdp + 4, kExtendedNumber = kUdp + 16;
constexpr std::uint32_t kExtended = 0x80, kKindMask = 0x7F, kNumberMask = 0xFFFFFF;
constexpr std::uint32_t kLeader = 1, kTrailer = 2, kData = 3;
// Of the payload type in a leader: 1 is an image, the upper bits are about chunks behind it.
constexpr std::uint32_t kPayloadType = 2, kPayloadMask = 0x3FFF, kImage = 1;
constexpr std::uint32_t kAll = 0xFFFFFFFF, kNothing = 0;

/// The packets with one kind of ids. A load beyond a packet's end drops it. Jumps count from the instruction behind them.
using Packets = std::array<sock_filter, 20>;
Packets packets_with(std::uint32_t header, std::uint32_t number, std::uint32_t number_mask, std::uint32_t most) {
  return {{BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0), BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kUdp + header, 0, 17),  // eq. 1
           BPF_STMT(BPF_LD | BPF_B | BPF_ABS, kKind), BPF_STMT(BPF_ALU | BPF_AND | BPF_K, kKindMask),
           // leader
           BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kLeader, 0, 3),
           BPF_STMT(BPF_LD | BPF_H | BPF_ABS, kUdp + header + kPayloadType),
           BPF_STMT(BPF_ALU | BPF_AND | BPF_K, kPayloadMask),
           BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kImage, 10, 11),  // eq. 2
           // trailer
           BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kTrailer, 0, 4), BPF_STMT(BPF_LD | BPF_W | BPF_ABS, number),
           BPF_STMT(BPF_ALU | BPF_AND | BPF_K, number_mask), BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 7, 0),
           BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, most + 1, 6, 5),  // eq. 4
           // data
           BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kData, 0, 5), BPF_STMT(BPF_LD | BPF_W | BPF_ABS, number),
           BPF_STMT(BPF_ALU | BPF_AND | BPF_K, number_mask), BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 2, 0),
           BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, most, 1, 0),  // eq. 3
           BPF_STMT(BPF_RET | BPF_K, kAll), BPF_STMT(BPF_RET | BPF_K, kNothing)}};
}

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
    return payload_bytes / room + (payload_bytes % room != 0);
  };
  const Packets plain = packets_with(kHeader, kNumber, kNumberMask, most(kHeader));
  const Packets extended = packets_with(kExtendedHeader, kExtendedNumber, kAll, most(kExtendedHeader));
  std::vector<sock_filter> code = {BPF_STMT(BPF_LD | BPF_B | BPF_ABS, kKind),
                                   BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, kExtended, std::tuple_size_v<Packets>, 0)};
  code.insert(code.end(), plain.begin(), plain.end());
  code.insert(code.end(), extended.begin(), extended.end());
  const sock_fprog program{.len = static_cast<unsigned short>(code.size()), .filter = code.data()};
  const auto fd = socket_on(port);
  return fd && setsockopt(*fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0;
}

}  // namespace fringecal::hw
