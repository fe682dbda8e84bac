// One question to a GigE Vision device, over a socket of its own: whether it is there, before a library that would wait
// for seconds is asked to open it. READREG and its acknowledge [GigEVision, 14.2]; port 3956.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace fringecal::hw {

constexpr int kGvcpPort = 3956;
constexpr std::uint32_t kControlChannelPrivilege = 0x0A00;  // 0: nobody controls the device

/// The register's value; absent where no answer came to any of three questions, each waiting a third of the limit.
std::optional<std::uint32_t> ask_register(const std::string& address, std::uint32_t place,
                                          std::chrono::milliseconds limit = std::chrono::milliseconds(600));

}  // namespace fringecal::hw
