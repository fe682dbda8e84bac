// Clock: time as the hardware code sees it, so that a test can make an hour pass at once.
#pragma once

#include <chrono>
#include <thread>

namespace fringecal::hw {

class Clock {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;
  virtual ~Clock() = default;
  virtual TimePoint now() const = 0;
  virtual void sleep_for(std::chrono::microseconds duration) = 0;
};

class SystemClock : public Clock {
 public:
  TimePoint now() const override { return std::chrono::steady_clock::now(); }
  void sleep_for(std::chrono::microseconds duration) override { std::this_thread::sleep_for(duration); }
};

}  // namespace fringecal::hw
