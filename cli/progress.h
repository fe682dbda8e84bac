// Progress on stderr: what is being done, how far, and an estimate of the time left. One line that rewrites itself on a
// terminal; one plain line per finished step where stderr is a file or a pipe.
#pragma once

#include <chrono>
#include <string>

namespace fringecal::cli {

class Progress {
 public:
  /// weight_total: the sum of the weights of all work to come, in any unit that is proportional to time.
  explicit Progress(double weight_total);
  ~Progress();

  /// Says what is under way now.
  void start(const std::string& what);
  /// Work of this weight is done. skipped: it was done in an earlier call and says nothing about the speed.
  void done(double weight, bool skipped = false);
  /// A finished step, one line that stays.
  void finish_step(const std::string& sentence);

 private:
  void draw();

  std::chrono::steady_clock::time_point begin_;
  double total_, done_ = 0, measured_ = 0;
  std::string what_;
  bool terminal_;
};

/// How long a piece of work took, for the report. 0 where SOURCE_DATE_EPOCH stops the clock: then equal runs give equal
/// files.
class Stopwatch {
 public:
  double seconds() const;

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace fringecal::cli
