#include "hw/modbus_plc.h"

#include <fmt/format.h>
#include <modbus/modbus.h>
#include <poll.h>

#include <cerrno>
#include <thread>

namespace fringecal::hw {
namespace {

char letter_of(Parity parity) { return parity == Parity::none ? 'N' : parity == Parity::even ? 'E' : 'O'; }

/// The PLC's own refusals, in words [Modbus, Application Protocol section 7].
std::string exception_words(int error) {
  const int code = error - MODBUS_ENOBASE;
  const char* words = "an exception without a meaning in the protocol";
  switch (error) {
    case EMBXILFUN:
      words = "illegal function";
      break;
    case EMBXILADD:
      words = "illegal data address";
      break;
    case EMBXILVAL:
      words = "illegal data value";
      break;
    case EMBXSFAIL:
      words = "device failure";
      break;
    case EMBXACK:
      words = "acknowledge, still working";
      break;
    case EMBXSBUSY:
      words = "device busy";
      break;
    case EMBXNACK:
      words = "negative acknowledge";
      break;
    case EMBXMEMPAR:
      words = "memory parity error";
      break;
    case EMBXGPATH:
      words = "gateway path unavailable";
      break;
    case EMBXGTAR:
      words = "the device behind the gateway does not respond";
      break;
    default:
      break;
  }
  return fmt::format("Modbus exception {} ({})", code, words);
}

}  // namespace

struct ModbusPlc::Link {
  modbus_t* context = nullptr;

  explicit Link(modbus_t* c) : context(c) {}
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;
  ~Link() {
    if (!context) return;
    modbus_close(context);
    modbus_free(context);
  }
};

ModbusPlc::ModbusPlc(PlcAddress address, PlcLinkOptions options)
    : RegisterPlc("PLC at " + address.text, options), address_(std::move(address)) {
  reopen();
}

ModbusPlc::~ModbusPlc() = default;

void ModbusPlc::reopen() {
  link_.reset();
  const SerialLine& line = address_.line;
  auto link = std::make_unique<Link>(
      address_.protocol == PlcProtocol::modbus_tcp
          ? modbus_new_tcp(address_.host.c_str(), address_.port)
          : modbus_new_rtu(line.device.c_str(), line.baud, letter_of(line.parity), 8, line.stop_bits));
  if (!link->context) throw PlcLost(fmt::format("{}: opening the link failed: {}", name(), modbus_strerror(errno)));
  const auto limit_us = std::chrono::duration_cast<std::chrono::microseconds>(options().answer_limit).count();
  const auto seconds = static_cast<std::uint32_t>(limit_us / 1000000);
  const auto rest_us = static_cast<std::uint32_t>(limit_us % 1000000);
  modbus_set_slave(link->context, address_.station);
  modbus_set_error_recovery(link->context, MODBUS_ERROR_RECOVERY_NONE);
  modbus_set_response_timeout(link->context, seconds, rest_us);
  modbus_set_byte_timeout(link->context, seconds, rest_us);  // a telegram that stops halfway is late as well
  if (modbus_connect(link->context) != 0) {
    throw PlcLost(fmt::format("{}: opening the link failed: {}", name(), modbus_strerror(errno)));
  }
  modbus_flush(link->context);
  link_ = std::move(link);
}

void ModbusPlc::read_words(std::uint16_t first, std::span<std::uint16_t> words) {
  if (!link_) throw PlcLost("the link is closed");
  const int count = static_cast<int>(words.size());
  if (modbus_read_registers(link_->context, first, count, words.data()) != count) fail();
}

void ModbusPlc::write_words(std::uint16_t first, std::span<const std::uint16_t> words) {
  if (!link_) throw PlcLost("the link is closed");
  const int count = static_cast<int>(words.size());
  if (modbus_write_registers(link_->context, first, count, words.data()) != count) fail();
}

void ModbusPlc::fail() {
  const int error = errno;
  if (error > MODBUS_ENOBASE && error <= EMBXGTAR) throw PlcFault(exception_words(error));
  if (error == ETIMEDOUT) {
    drain();
    throw PlcLate(fmt::format("no answer within {} ms", options().answer_limit.count()));
  }
  if (error == EMBBADDATA || error == EMBBADCRC || error == EMBBADSLAVE || error == EMBBADEXC || error == EMBMDATA) {
    drain();
    throw PlcLate(fmt::format("an answer that does not belong to the question ({})", modbus_strerror(error)));
  }
  link_.reset();
  throw PlcLost(modbus_strerror(error));
}

void ModbusPlc::drain() {
  pollfd line{.fd = modbus_get_socket(link_->context), .events = POLLIN, .revents = 0};
  if (::poll(&line, 1, static_cast<int>(options().answer_limit.count())) > 0) {
    // The longest telegram of the map, 33 bytes, takes 19 ms at 19200 baud.
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  modbus_flush(link_->context);
}

}  // namespace fringecal::hw
