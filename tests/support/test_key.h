// Keys and certificates for tests, made on the spot with the openssl command.
#pragma once

#include "reports/process.h"

#include <chrono>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace fringecal::test {

inline reports::FilterOutput run(const std::vector<std::string>& arguments, const std::string& input = "") {
  return reports::run_filter(arguments, input, std::chrono::seconds(120), "the tests need it: see ./dev");
}

/// Writes NAME.key (mode 0600) and NAME.pem, a self-signed certificate. kind: "ec" or "rsa".
inline void make_test_key(const std::filesystem::path& folder, const std::string& name, const std::string& kind,
                          const std::string& subject = "/C=DE/O=Example/CN=fringecal TEST key") {
  const auto key = (folder / (name + ".key")).string(), certificate = (folder / (name + ".pem")).string();
  std::vector<std::string> arguments = {"openssl", "req", "-x509", "-newkey", kind == "ec" ? "ec" : "rsa:2048"};
  if (kind == "ec") arguments.insert(arguments.end(), {"-pkeyopt", "ec_paramgen_curve:prime256v1"});
  arguments.insert(arguments.end(),
                   {"-sha256", "-nodes", "-days", "3650", "-subj", subject, "-keyout", key, "-out", certificate});
  if (run(arguments).status != 0) throw std::runtime_error("openssl makes no key");
  std::filesystem::permissions(key, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
}

}  // namespace fringecal::test
