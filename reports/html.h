// HTML without a template language: text becomes markup only by being escaped, and the type says which of the two it
// is.
//
//   Markup p = element("p", text("2 < 3"));                        <p>2 &lt; 3</p>
//   Markup a = element("td", {{"class", "number"}}, text("7.1"));  <td class="number">7.1</td>
// Text that is not valid UTF-8, and control characters, are shown as U+FFFD. [HTML Living Standard, 13.1]
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fringecal::reports {

/// Markup that may stand in a page as it is.
class Markup {
 public:
  Markup() = default;
  /// For markup written by this program (a plot, a style sheet); never for a text that came from outside.
  static Markup trusted(std::string html) {
    Markup out;
    out.html_ = std::move(html);
    return out;
  }
  Markup& operator+=(const Markup& more) {
    html_ += more.html_;
    return *this;
  }
  friend Markup operator+(Markup a, const Markup& b) { return a += b; }
  const std::string& html() const { return html_; }
  bool empty() const { return html_.empty(); }

 private:
  std::string html_;
};

/// & < > " ' escaped, so that it is safe in content and in a quoted attribute.
std::string escape(std::string_view text);
Markup text(std::string_view text);

using Attributes = std::vector<std::pair<std::string, std::string>>;
Markup element(std::string_view tag, const Attributes& attributes, const Markup& content);
inline Markup element(std::string_view tag, const Markup& content) { return element(tag, Attributes{}, content); }

/// A titled part of the page with an anchor.
Markup section(const std::string& id, std::string_view title, const Markup& content);
/// A picture with its caption; kind is a class of the style sheet ("wide", "half", "third").
Markup figure(std::string_view kind, const Markup& picture, std::string_view caption);

struct Column {
  std::string title;
  std::string kind;   // class of its cells: "" (words) | "number"
  std::string group;  // neighbours of the same group stand under one heading
};
/// A table; each row has one cell per column.
Markup table(std::string_view kind, const std::vector<Column>& columns, const std::vector<std::vector<Markup>>& rows);

/// "mm^-2" -> mm<sup>−2</sup>; other text as it is.
Markup unit(std::string_view text);

/// The whole document with the style sheet of the reports.
std::string page(std::string_view title, const Markup& body);

/// RFC 4648.
std::string base64(std::string_view bytes);

}  // namespace fringecal::reports
