#include "hw/virtual/modbus_server.h"

#include <array>
#include <optional>
#include <vector>

namespace fringecal::virt {
namespace {

constexpr int kIllegalFunction = 1, kIllegalAddress = 2, kIllegalValue = 3;
constexpr std::size_t kMostRead = 125, kMostWritten = 123;

std::uint8_t byte_at(std::string_view bytes, std::size_t k) { return static_cast<std::uint8_t>(bytes[k]); }
std::uint16_t word_at(std::string_view bytes, std::size_t k) {
  return static_cast<std::uint16_t>(byte_at(bytes, k) << 8 | byte_at(bytes, k + 1));
}
void append_word(std::string& bytes, unsigned word) {
  bytes.push_back(static_cast<char>(word >> 8));
  bytes.push_back(static_cast<char>(word & 0xFFu));
}

std::string exception_pdu(std::uint8_t function, int code) {
  return {static_cast<char>(function | 0x80), static_cast<char>(code)};
}

std::string read_registers(PlcCore& core, std::string_view pdu) {
  const std::size_t count = pdu.size() == 5 ? word_at(pdu, 3) : 0;
  if (count < 1 || count > kMostRead) return exception_pdu(3, kIllegalValue);
  std::vector<std::uint16_t> words(count);
  if (!core.read(word_at(pdu, 1), words)) return exception_pdu(3, kIllegalAddress);
  std::string out = {3, static_cast<char>(2 * count)};
  for (const std::uint16_t w : words) append_word(out, w);
  return out;
}

std::string write_registers(PlcCore& core, std::string_view pdu) {
  const std::size_t count = pdu.size() >= 6 ? word_at(pdu, 3) : 0;
  if (count < 1 || count > kMostWritten || pdu.size() != 6 + 2 * count || byte_at(pdu, 5) != 2 * count) {
    return exception_pdu(16, kIllegalValue);
  }
  std::vector<std::uint16_t> words;
  for (std::size_t k = 0; k < count; ++k) words.push_back(word_at(pdu, 6 + 2 * k));
  if (!core.write(word_at(pdu, 1), words)) return exception_pdu(16, kIllegalAddress);
  return std::string(pdu.substr(0, 5));
}

std::string write_register(PlcCore& core, std::string_view pdu) {
  if (pdu.size() != 5) return exception_pdu(6, kIllegalValue);
  const std::array<std::uint16_t, 1> word = {word_at(pdu, 3)};
  if (!core.write(word_at(pdu, 1), word)) return exception_pdu(6, kIllegalAddress);
  return std::string(pdu);
}

/// The answer to one PDU, with the injected faults.
ByteServer::Answer answer_pdu(PlcCore& core, std::string_view pdu) {
  const AnswerFault fault = core.next_answer();
  const std::uint8_t function = byte_at(pdu, 0);
  ByteServer::Answer answer{.bytes = "", .delay = fault.delay};
  if (fault.refusal != 0) {
    answer.bytes = exception_pdu(function, fault.refusal);
  } else if (function == 3) {
    answer.bytes = read_registers(core, pdu);
  } else if (function == 6) {
    answer.bytes = write_register(core, pdu);
  } else if (function == 16) {
    answer.bytes = write_registers(core, pdu);
  } else {
    answer.bytes = exception_pdu(function, kIllegalFunction);
  }
  if (fault.silent) answer.bytes.clear();
  return answer;
}

std::optional<ByteServer::Answer> answer_tcp(PlcCore& core, std::string& received) {
  constexpr std::size_t kHeader = 7, kMostBytes = 260;
  if (received.size() < kHeader) return std::nullopt;
  const std::size_t length = word_at(received, 4);  // of unit and PDU
  if (word_at(received, 2) != 0 || length < 2 || length + 6 > kMostBytes) {
    received.clear();  // not Modbus; nothing in it can be trusted
    return std::nullopt;
  }
  if (received.size() < 6 + length) return std::nullopt;
  const std::string request = received.substr(0, 6 + length);
  received.erase(0, 6 + length);
  ByteServer::Answer answer = answer_pdu(core, std::string_view(request).substr(kHeader));
  if (answer.bytes.empty()) return answer;
  std::string framed = request.substr(0, 4);
  append_word(framed, static_cast<unsigned>(answer.bytes.size() + 1));
  framed += request[6] + answer.bytes;
  answer.bytes = std::move(framed);
  return answer;
}

/// Bytes of the RTU request that begins here; nothing where more must come to tell. A function without a known length
/// takes all that is there.
std::optional<std::size_t> rtu_length(std::string_view received) {
  if (received.size() < 4) return std::nullopt;
  const std::uint8_t function = byte_at(received, 1);
  if (function >= 1 && function <= 6) return 8;
  if (function != 15 && function != 16) return received.size();
  if (received.size() < 7) return std::nullopt;
  return 9u + byte_at(received, 6);
}

std::optional<ByteServer::Answer> answer_rtu(PlcCore& core, int slave, std::string& received) {
  const auto length = rtu_length(received);
  if (!length || received.size() < *length) return std::nullopt;
  const std::string request = received.substr(0, *length);
  const std::string_view body = std::string_view(request).substr(0, *length - 2);
  const auto crc = static_cast<std::uint16_t>(byte_at(request, *length - 1) << 8 | byte_at(request, *length - 2));
  if (crc != modbus_crc(body)) {
    received.clear();  // without a right CRC nobody knows where the next request begins: wait for silence
    return std::nullopt;
  }
  received.erase(0, *length);
  const std::uint8_t addressed = byte_at(request, 0);
  if (addressed != 0 && addressed != slave) return ByteServer::Answer{};
  ByteServer::Answer answer = answer_pdu(core, body.substr(1));
  if (addressed == 0 || answer.bytes.empty()) return ByteServer::Answer{};
  std::string framed = request[0] + answer.bytes;
  const std::uint16_t own = modbus_crc(framed);
  framed.push_back(static_cast<char>(own & 0xFFu));
  framed.push_back(static_cast<char>(own >> 8));
  answer.bytes = std::move(framed);
  return answer;
}

}  // namespace

std::uint16_t modbus_crc(std::string_view bytes) {
  std::uint16_t crc = 0xFFFF;
  for (const char c : bytes) {
    crc ^= static_cast<std::uint8_t>(c);
    for (int bit = 0; bit < 8; ++bit) crc = static_cast<std::uint16_t>(crc & 1 ? crc >> 1 ^ 0xA001 : crc >> 1);  // (1)
  }
  return crc;
}

std::unique_ptr<ByteServer> serve_modbus_tcp(PlcCore& core, const std::string& host, int port) {
  return ByteServer::on_tcp(host, port, [&core](std::string& received) { return answer_tcp(core, received); });
}

std::unique_ptr<ByteServer> serve_modbus_rtu(PlcCore& core, int slave, const std::string& link) {
  return ByteServer::on_pty(link, [&core, slave](std::string& received) { return answer_rtu(core, slave, received); });
}

}  // namespace fringecal::virt
