#include "tests/web/browser.h"

#include "core/file.h"
#include "tests/support/other_programs.h"
#include "tests/web/served.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <stdexcept>
#include <thread>

namespace fringecal::test {
namespace {

std::string decoded(const std::string& base64) {
  std::string out;
  unsigned bits = 0, have = 0;
  for (const char c : base64) {
    const unsigned v = c >= 'A' && c <= 'Z'   ? static_cast<unsigned>(c - 'A')
                       : c >= 'a' && c <= 'z' ? static_cast<unsigned>(c - 'a' + 26)
                       : c >= '0' && c <= '9' ? static_cast<unsigned>(c - '0' + 52)
                       : c == '+'             ? 62u
                       : c == '/'             ? 63u
                                              : 64u;
    if (v > 63) continue;
    bits = bits << 6 | v;
    have += 6;
    if (have >= 8) out += static_cast<char>(bits >> (have -= 8) & 255);
  }
  return out;
}

}  // namespace

bool Browser::installed() { return test::installed("chromedriver") && test::installed("chromium"); }

Browser::Browser(Drawing drawing) : port_(Served::free_port()) {
  process_ = fork();
  if (process_ == 0) {
    const int nowhere = ::open("/dev/null", O_RDWR);
    for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) dup2(nowhere, stream);
    setpgid(0, 0);
    const std::string port = fmt::format("--port={}", port_);
    execlp("chromedriver", "chromedriver", port.c_str(), static_cast<char*>(nullptr));
    _exit(127);
  }
  for (int i = 0; i < 300; ++i) {
    if (talk(port_, Served::request("GET", "/status", fmt::format("Host: 127.0.0.1:{}\r\n", port_))).status == 200)
      break;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  // No sandbox, because tests often run as root; nothing that asks for an outside address.
  const std::string webgl = drawing == Drawing::webgl ? R"("--use-angle=swiftshader", "--enable-unsafe-swiftshader", )"
                                                      : R"("--disable-gpu", )";
  const Value made =
      command("POST", "/session",
              R"({"capabilities": {"alwaysMatch": {"browserName": "chrome", "goog:chromeOptions": {"args": [)" + webgl +
                  R"("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,720",
      "--hide-scrollbars", "--disable-background-networking", "--disable-component-update", "--no-first-run", "--lang=en"],
      "prefs": {"intl.accept_languages": "en"}}}}})");
  const Value* id = made.find("sessionId");
  if (!id || !id->if_text()) throw std::runtime_error("no browser: " + to_json(made));
  session_ = *id->if_text();
}

Browser::~Browser() {
  try {
    if (!session_.empty()) command("DELETE", "/session/" + session_, "");
  } catch (const std::exception&) {  // the process group is ended in any case
  }
  kill(-process_, SIGKILL);
  waitpid(process_, nullptr, 0);
}

Value Browser::command(const std::string& method, const std::string& path, const std::string& body) {
  const std::string head =
      fmt::format("Host: 127.0.0.1:{}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n", port_, body.size());
  const Answer a = talk(port_, Served::request(method, path, head) + body, 90);
  if (a.body.empty())
    throw std::runtime_error(fmt::format("chromedriver gave no answer to {} (status {})", path, a.status));
  const Value answer = parse_json(a.body, "chromedriver");
  const Value* value = answer.find("value");
  if (a.status != 200 || !value) throw std::runtime_error(fmt::format("{}: {} {}", path, a.status, a.body));
  return *value;
}

void Browser::resize(int width, int height) {
  // The size of what is shown, not of the window around it.
  command(
      "POST", fmt::format("/session/{}/goog/cdp/execute", session_),
      fmt::format(
          R"({{"cmd": "Emulation.setDeviceMetricsOverride", "params": {{"width": {}, "height": {}, "deviceScaleFactor": 1, "mobile": false}}}})",
          width, height));
}

void Browser::open(const std::string& url) {
  command("POST", fmt::format("/session/{}/url", session_), to_json(Value::object().set("url", url)));
}

Value Browser::evaluate(const std::string& body) {
  const std::string script = "const done = arguments[arguments.length - 1]; (async () => {" + body +
                             "})().then(v => done({value: v ?? null}), e => done({error: String(e)}));";
  const Value answer = command("POST", fmt::format("/session/{}/execute/async", session_),
                               to_json(Value::object().set("script", script).set("args", Value::array())));
  if (const Value* error = answer.find("error")) throw std::runtime_error(to_json(*error) + " in " + body);
  const Value* value = answer.find("value");
  return value ? *value : Value();
}

std::string Browser::text(const std::string& body) {
  const Value value = evaluate(body);
  return value.if_text() ? *value.if_text() : "";
}

bool Browser::wait_for(const std::string& expression, double limit_s) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(limit_s);
  do {
    const Value value = evaluate("return Boolean(" + expression + ");");
    if (value.if_bool() && *value.if_bool()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  } while (std::chrono::steady_clock::now() < end);
  return false;
}

void Browser::click(const std::string& selector, double limit_s) {
  const std::string found = fmt::format("document.querySelector('{}')", selector);
  if (!wait_for(fmt::format("{0} && !{0}.disabled && {0}.getClientRects().length", found), limit_s)) {
    throw std::runtime_error("nothing to click: " + selector);
  }
  const Value element = command("POST", fmt::format("/session/{}/element", session_),
                                to_json(Value::object().set("using", "css selector").set("value", selector)));
  const std::string id = *element.if_object()->front().second.if_text();
  command("POST", fmt::format("/session/{}/element/{}/click", session_, id));
}

void Browser::screenshot(const std::filesystem::path& file) {
  const Value png = command("GET", fmt::format("/session/{}/screenshot", session_), "");
  write_atomically(file, decoded(*png.if_text()));
}

}  // namespace fringecal::test
