// RegisterPlc: the register map (hw/plc_map.md) on top of reading and writing words, whatever carries them.
//
// Every transaction of the map is harmless when it is done twice, so one that got no answer in time is repeated
// (`attempts`) before the link counts as lost. Failures:
//   PlcLost   no link, no answer in time, or answers that are not of this protocol
//   PlcFault  the PLC refuses the operation, or speaks another register map
// Both messages name the PLC, the operation and the cause.
#pragma once

#include "hw/plc.h"
#include "hw/plc_map.h"

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace fringecal::hw {

struct PlcLinkOptions {
  std::chrono::milliseconds answer_limit{500};  // an FP0 at 9600 baud needs about 130 ms for the status block
  int attempts = 2;                             // a single lost telegram is repeated, a dead line is reported soon
};

/// No answer within the limit: the same telegram can be sent again.
struct PlcLate : PlcLost {
  using PlcLost::PlcLost;
};

/// What is in front of the virtual scanner, and how it was drawn.
struct VirtualSelection {
  std::uint16_t scene = 0, pose = 0;  // kSceneNames
  std::uint64_t stack_seed = 0;
  std::uint16_t warm_up_min = kWarmedUp;

  friend bool operator==(const VirtualSelection&, const VirtualSelection&) = default;
};

class RegisterPlc : public Plc, public MotorisedAdjuster {
 public:
  RegisterPlc(std::string name, PlcLinkOptions options) : name_(std::move(name)), options_(options) {}

  std::string identity() override;
  PlcStatus status() override;
  void command(PlcCommand command, std::uint16_t sequence, std::uint16_t target_pattern = 0) override;
  void set_lamp(bool on, double level = 1.0) override;
  void feed_watchdog() override;

  /// Of the virtual scanner only; PlcFault on a real one.
  void turn_mrad(double turn) override;
  void select(const VirtualSelection& selection);
  bool is_virtual();

  /// Answers that came too late or not at all since the start, each of them repeated.
  int late_answers() const { return late_answers_; }

 protected:
  /// One transaction each. Throw PlcLate, PlcLost or PlcFault with the cause alone; name and operation are added here.
  virtual void read_words(std::uint16_t first, std::span<std::uint16_t> words) = 0;
  virtual void write_words(std::uint16_t first, std::span<const std::uint16_t> words) = 0;

  const std::string& name() const { return name_; }
  const PlcLinkOptions& options() const { return options_; }

 private:
  template <class Work>
  void transact(const std::string& operation, const Work& work);
  void read(std::uint16_t first, std::span<std::uint16_t> words, const std::string& operation);
  void write(std::uint16_t first, std::span<const std::uint16_t> words, const std::string& operation);
  void require_virtual(const std::string& operation);

  std::string name_;
  PlcLinkOptions options_;
  std::optional<std::uint16_t> watchdog_;  // the value written last; absent: nobody knows what stands in DT25
  int late_answers_ = 0;
};

}  // namespace fringecal::hw
