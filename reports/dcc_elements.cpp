#include "reports/dcc_elements.h"

#include "core/error.h"
#include "reports/certificate_dcc.h"

#include <fmt/format.h>

#include <array>
#include <utility>

namespace fringecal::reports {
namespace {

constexpr std::array<std::pair<const char*, const char*>, 10> kUnits = {{{"mm", "\\milli\\metre"},
                                                                         {"um", "\\micro\\metre"},
                                                                         {"µm", "\\micro\\metre"},
                                                                         {"m", "\\metre"},
                                                                         {"°C", "\\degreecelsius"},
                                                                         {"degC", "\\degreecelsius"},
                                                                         {"%", "\\percent"},
                                                                         {"1", "\\one"},
                                                                         {"mrad", "\\milli\\radian"},
                                                                         {"rad", "\\radian"}}};

/// U+FFFE and U+FFFF are UTF-8 but not XML [XML 1.0, production 2].
std::string xml_text(std::string words) {
  for (const std::string_view forbidden : {"\xEF\xBF\xBE", "\xEF\xBF\xBF"}) {
    for (auto at = words.find(forbidden); at != std::string::npos; at = words.find(forbidden, at)) {
      words.replace(at, forbidden.size(), "\uFFFD");
    }
  }
  return words;
}

}  // namespace

std::string dsi_unit(const std::string& unit) {
  for (const auto& [ours, dsi] : kUnits) {
    if (unit == ours) return dsi;
  }
  throw InputError(
      fmt::format("the unit \"{}\" has no D-SI name in this program; known: mm, um, m, degC, %, 1, mrad, rad", unit));
}

std::string unit_of_dsi(const std::string& dsi) {
  for (const auto& [ours, known] : kUnits) {
    if (dsi == known) return ours;
  }
  return dsi;
}

namespace dcc {

std::string one_line(const std::string& words) {
  std::string out;
  bool space = false;
  for (const char c : words) {
    if (c == ' ' || c == '\t' || c == '\n' || c == '\r') {
      space = !out.empty();
      continue;
    }
    if (space) out += ' ';
    space = false;
    out += c;
  }
  return out;
}

Markup node(const std::string& tag, const Markup& content, const std::string& ref_type) {
  return element("dcc:" + tag, {{"refType", ref_type}}, content) + Markup::trusted("\n");
}

Markup leaf(const std::string& tag, const std::string& words, const std::string& ref_type) {
  const std::string line = one_line(words);
  return line.empty() ? Markup() : node(tag, text(xml_text(line)), ref_type);
}

Markup texts(const std::string& tag, const std::vector<std::string>& words, const std::string& language) {
  Markup contents;
  for (const auto& one : words) {
    if (!one.empty()) contents += element("dcc:content", {{"lang", language}}, text(xml_text(one)));
  }
  return contents.empty() ? Markup() : node(tag, contents);
}

Markup real(const Real& r) {
  Markup content = element("si:value", text(r.value)) + element("si:unit", text(dsi_unit(r.unit)));
  if (!r.U.empty()) {
    // "95.45" -> "0.9545"
    std::string digits = r.coverage_percent;
    auto point = digits.find('.');
    if (point == std::string::npos) point = digits.size();
    std::erase(digits, '.');
    const std::string probability = point >= 3 ? "1" : "0." + std::string(2 - point, '0') + digits;
    content += element(
        "si:measurementUncertaintyUnivariate",
        element("si:expandedMU", element("si:valueExpandedMU", text(r.U)) + element("si:coverageFactor", text(r.k)) +
                                     element("si:coverageProbability", text(probability)) +
                                     element("si:distribution", text("normal"))));
  }
  return element("si:real", content) + Markup::trusted("\n");
}

Markup quantity(const std::string& ref_type, const Markup& name, const Markup& value, const Markup& more) {
  return node("quantity", name + value + more, ref_type);
}

Markup embedded(const Embedded& file, const Markup& description, const std::string& ref_type) {
  return node(file.tag,
              description + leaf("fileName", file.file_name) + leaf("mimeType", file.mime_type) +
                  node("dataBase64", Markup::trusted(base64(file.bytes))),
              ref_type);
}

}  // namespace dcc
}  // namespace fringecal::reports
