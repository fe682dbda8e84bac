// Times of one run side by side: rounds in which every contender works once, medians over the rounds. In milliseconds of
// this process's processor time where it works alone on one thread, which other programs on the machine disturb less
// than the clock on the wall.
#pragma once

#include <algorithm>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

namespace fringecal::bench {

inline double clock_ms(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

struct Contender {
  std::string name;
  std::function<void()> work;
  int every = 1;  // slow ones take part in every n-th round only
  std::vector<double> times_ms{};
};

inline double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The first round warms up and does not count.
inline void race(std::vector<Contender>& contenders, int rounds, clockid_t clock) {
  for (int round = 0; round <= rounds; ++round) {
    for (Contender& c : contenders) {
      if (round % c.every != 0 && round != 1) continue;
      const double start = clock_ms(clock);
      c.work();
      if (round > 0) c.times_ms.push_back(clock_ms(clock) - start);
    }
  }
}

}  // namespace fringecal::bench
