#include "reports/number.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::reports {
namespace {

constexpr const char* kMinus = "\u2212";

/// Exponent of the leading digit after rounding to `digits` significant digits: 0.0996 with two digits leads at 10^-1.
int leading_exponent(double value, int digits) {
  const std::string text = fmt::format("{:.{}e}", std::abs(value), digits - 1);
  return std::stoi(text.substr(text.find('e') + 1));
}

std::string power_of_ten(int exponent) {
  static const char* const kDigits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out = " × 10";
  if (exponent < 0) out += "⁻";
  for (const char c : std::to_string(std::abs(exponent))) out += kDigits[c - '0'];
  return out;
}

/// value rounded to a multiple of 10^-decimals; negative decimals round to tens, hundreds, ...
std::string at_place(double value, int decimals) {
  if (decimals >= 0) return fixed(value, decimals);
  const double step = std::pow(10.0, -decimals);
  return fixed(std::round(value / step) * step, 0);
}

}  // namespace

std::string fixed(double value, int decimals) {
  require(std::isfinite(value), "a number in a report is finite");
  std::string text = fmt::format("{:.{}f}", std::abs(value), decimals);
  const bool is_zero = text.find_first_not_of("0.") == std::string::npos;
  return (value < 0 && !is_zero ? kMinus : "") + text;
}

std::string significant(double value, int digits) {
  require(std::isfinite(value), "a number in a report is finite");
  if (value == 0.0) return "0";
  const int exponent = leading_exponent(value, digits);
  if (exponent >= -4 && exponent < 7) return at_place(value, digits - 1 - exponent);
  return fixed(value / std::pow(10.0, exponent), digits - 1) + power_of_ten(exponent);
}

Rounded rounded(double value, double u) {
  require(std::isfinite(value) && std::isfinite(u) && u >= 0, "an uncertainty in a report is finite and not negative");
  if (u == 0.0) return {significant(value, 6), "0"};
  const int place = leading_exponent(u, 2) - 1;  // of u's second digit
  const int leading = value == 0.0 ? place + 1 : std::max(leading_exponent(value, 6), place + 1);
  if (place >= -6 && leading < 7) return {at_place(value, -place), at_place(u, -place)};
  const double scale = std::pow(10.0, leading);
  return {fixed(value / scale, leading - place) + power_of_ten(leading),
          fixed(u / scale, leading - place) + power_of_ten(leading)};
}

std::string without_end_zeros(std::string number) {
  const auto point = number.find('.');
  if (point == std::string::npos) return number;
  auto end = point + 1;
  while (end < number.size() && number[end] >= '0' && number[end] <= '9') ++end;
  auto keep = end;
  while (number[keep - 1] == '0') --keep;
  if (number[keep - 1] == '.') --keep;
  return number.erase(keep, end - keep);
}

std::string with_sign(std::string number) {
  const bool is_zero = number.find_first_not_of("0.") == std::string::npos;
  if (is_zero || number.starts_with(kMinus)) return number;
  return "+" + number;
}

std::string duration(double seconds) {
  if (seconds < 9.95) return fixed(seconds, 1) + " s";
  const auto whole = static_cast<long>(std::lround(seconds));
  if (whole < 60) return fmt::format("{} s", whole);
  return fmt::format("{} min {:02} s", whole / 60, whole % 60);
}

}  // namespace fringecal::reports
