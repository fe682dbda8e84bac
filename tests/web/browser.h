// A headless Chromium, driven as a user would through chromedriver (W3C WebDriver: JSON over HTTP).
#pragma once

#include "core/value.h"

#include <filesystem>
#include <string>

namespace fringecal::test {

class Browser {
 public:
  /// Whether this machine has one; a test without it skips by name.
  static bool installed();

  /// webgl: drawn by software, which slows everything else down.
  enum class Drawing { flat, webgl };
  explicit Browser(Drawing drawing = Drawing::flat);
  ~Browser();
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  void resize(int width, int height);
  void open(const std::string& url);
  /// The value of a JavaScript function body; promises are awaited. Throws std::runtime_error with what went wrong.
  Value evaluate(const std::string& body);
  std::string text(const std::string& body);  // of an evaluation that gives a text
  /// Clicks what the CSS selector finds; waits for it to be there and enabled.
  void click(const std::string& selector, double limit_s = 20);
  /// Waits until the expression is true.
  bool wait_for(const std::string& expression, double limit_s);
  /// PNG of the window.
  void screenshot(const std::filesystem::path& file);

 private:
  Value command(const std::string& method, const std::string& path, const std::string& body = "{}");

  int port_ = 0, process_ = -1;
  std::string session_;
};

}  // namespace fringecal::test
