// `fringecal virtual` as a child of this program: started, asked where it serves, and ended again on every way out.
//
// The child has a process group of its own, so that Ctrl-C in a terminal reaches this program alone, which first parks
// the stage. It ends with this program however that ends, SIGKILL included (`--parent`), and takes addresses that are
// free, so a program that was killed can be started again at once.
#pragma once

#include <string>
#include <vector>

namespace fringecal::cli {

class VirtualChild {
 public:
  /// arguments: of `fringecal virtual`, without addresses. Returns when it serves. Throws EnvironmentError where it
  /// does not start; what it says about that stands on standard error.
  explicit VirtualChild(const std::vector<std::string>& arguments);
  /// SIGTERM, and SIGKILL where it has not ended after ten seconds.
  ~VirtualChild();
  VirtualChild(const VirtualChild&) = delete;
  VirtualChild& operator=(const VirtualChild&) = delete;

  const std::string& camera() const { return camera_; }              // IPv4 address
  const std::string& pixel_format() const { return pixel_format_; }  // "Mono8"
  const std::string& plc() const { return plc_; }                    // "modbus-tcp://127.0.1.1:41234"

 private:
  void read_ready_line();
  void end();

  int process_ = -1, output_ = -1;
  std::string camera_, pixel_format_, plc_;
};

}  // namespace fringecal::cli
