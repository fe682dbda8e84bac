#include "hw/gvcp.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>

namespace fringecal::hw {

std::optional<std::uint32_t> ask_register(const std::string& address, std::uint32_t place,
                                          std::chrono::milliseconds limit) {
  constexpr int kQuestions = 3;
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(kGvcpPort);
  if (inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1) return std::nullopt;
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return std::nullopt;
  std::optional<std::uint32_t> value;
  for (std::uint8_t question = 1; !value && question <= kQuestions; ++question) {
    std::array<std::uint8_t, 12> command = {0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0x66, question};
    for (unsigned i = 0; i < 4; ++i) command[8 + i] = static_cast<std::uint8_t>(place >> (24 - 8 * i));
    sendto(fd, command.data(), command.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    pollfd answer{fd, POLLIN, 0};
    if (poll(&answer, 1, static_cast<int>(limit.count() / kQuestions)) <= 0) continue;
    std::array<std::uint8_t, 64> reply;
    // Status 0, READREG acknowledge, 4 bytes, and the number of one of our questions.
    if (recv(fd, reply.data(), reply.size(), 0) != 12 || reply[0] || reply[1] || reply[3] != 0x81 || reply[6] != 0x66) {
      continue;
    }
    std::uint32_t sum = 0;
    for (std::size_t i = 8; i < 12; ++i) sum = sum << 8 | reply[i];
    value = sum;
  }
  close(fd);
  return value;
}

}  // namespace fringecal::hw
