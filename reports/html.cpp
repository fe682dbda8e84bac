#include "reports/html.h"

#include "core/error.h"

#include <fmt/format.h>

#include <cstdint>

namespace fringecal::reports {
namespace {

constexpr const char* kReplacement = "\uFFFD";

/// Length of the valid UTF-8 sequence at the front of s; 0 where there is none [RFC 3629, section 4].
std::size_t utf8_length(std::string_view s) {
  const auto byte = [&](std::size_t k) { return static_cast<std::uint8_t>(s[k]); };
  const std::uint8_t first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t n = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || s.size() < n) return 0;
  for (std::size_t k = 1; k < n; ++k) {
    if ((byte(k) & 0xC0) != 0x80) return 0;
  }
  const bool overlong = (first == 0xE0 && byte(1) < 0xA0) || (first == 0xF0 && byte(1) < 0x90);
  const bool surrogate = first == 0xED && byte(1) > 0x9F;
  const bool beyond = first == 0xF4 && byte(1) > 0x8F;
  return overlong || surrogate || beyond ? 0 : n;
}

Markup row_of_headings(const std::vector<Column>& columns) {
  Markup cells;
  for (const auto& column : columns) {
    cells += element("th", {{"scope", "col"}, {"class", column.kind}}, text(column.title));
  }
  return element("tr", cells);
}

Markup row_of_groups(const std::vector<Column>& columns) {
  Markup cells;
  bool any = false;
  for (std::size_t k = 0; k < columns.size();) {
    std::size_t end = k + 1;
    while (end < columns.size() && columns[end].group == columns[k].group) ++end;
    const std::string& group = columns[k].group;
    any = any || !group.empty();
    cells +=
        element("th", {{"colspan", std::to_string(end - k)}, {"class", group.empty() ? "" : "group"}}, text(group));
    k = end;
  }
  return any ? element("tr", {{"class", "groups"}}, cells) : Markup();
}

}  // namespace

std::string escape(std::string_view s) {
  std::string out;
  out.reserve(s.size() + s.size() / 8);
  while (!s.empty()) {
    const std::size_t n = utf8_length(s);
    const char c = s.front();
    const bool is_control = (static_cast<std::uint8_t>(c) < 0x20 && c != '\n' && c != '\t') || c == 0x7F;
    if (n == 0 || is_control) {
      out += kReplacement;
    } else if (n > 1) {
      out += s.substr(0, n);
    } else if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '"') {
      out += "&quot;";
    } else if (c == '\'') {
      out += "&#39;";
    } else {
      out += c;
    }
    s.remove_prefix(n == 0 ? 1 : n);
  }
  return out;
}

Markup text(std::string_view s) { return Markup::trusted(escape(s)); }

Markup element(std::string_view tag, const Attributes& attributes, const Markup& content) {
  std::string html = fmt::format("<{}", tag);
  for (const auto& [name, value] : attributes) {
    if (!value.empty()) html += fmt::format(" {}=\"{}\"", name, escape(value));
  }
  html += ">";
  if (tag == "img" || tag == "br") return Markup::trusted(html);  // void elements have no end tag
  return Markup::trusted(html + content.html() + fmt::format("</{}>", tag));
}

Markup section(const std::string& id, std::string_view title, const Markup& content) {
  return element("section", {{"id", id}}, element("h2", text(title)) + content) + Markup::trusted("\n");
}

Markup figure(std::string_view kind, const Markup& picture, std::string_view caption) {
  return element("figure", {{"class", std::string(kind)}}, picture + element("figcaption", text(caption))) +
         Markup::trusted("\n");
}

Markup table(std::string_view kind, const std::vector<Column>& columns, const std::vector<std::vector<Markup>>& rows) {
  Markup body;
  for (const auto& row : rows) {
    require(row.size() == columns.size(), "a table row has one cell per column");
    Markup cells;
    for (std::size_t k = 0; k < row.size(); ++k) {
      cells += k == 0 ? element("th", {{"scope", "row"}, {"class", columns[k].kind}}, row[k])
                      : element("td", {{"class", columns[k].kind}}, row[k]);
    }
    body += element("tr", cells) + Markup::trusted("\n");
  }
  return element("table", {{"class", std::string(kind)}},
                 element("thead", row_of_groups(columns) + row_of_headings(columns)) + element("tbody", body)) +
         Markup::trusted("\n");
}

Markup unit(std::string_view s) {
  const auto hat = s.find('^');
  if (hat == std::string_view::npos) return text(s);
  std::string power(s.substr(hat + 1));
  if (power.starts_with('-')) power = "\u2212" + power.substr(1);
  return text(s.substr(0, hat)) + element("sup", text(power));
}

std::string base64(std::string_view bytes) {
  static const char kLetters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t k = 0; k < bytes.size(); k += 3) {
    std::uint32_t word = 0;
    for (std::size_t b = 0; b < 3; ++b) {
      word = word << 8 | (k + b < bytes.size() ? static_cast<std::uint8_t>(bytes[k + b]) : 0u);
    }
    for (std::size_t c = 0; c < 4; ++c) {
      out += k + c <= bytes.size() ? kLetters[word >> (18 - 6 * c) & 63u] : '=';
    }
  }
  return out;
}

}  // namespace fringecal::reports
