// Numbers for people: rounded by their uncertainty, which is given with two significant digits, the value to the same
// place [GUM, 7.2.6]. Typographic minus (U+2212), no thousands separators, whatever the locale.
// All throw std::logic_error for a number that is not finite.
#pragma once

#include <string>

namespace fringecal::reports {

struct Rounded {
  std::string value, u;
};

/// (1234.5678, 0.0123) -> "1234.568", "0.012"; (2.5e-6, 1e-7) -> "2.50 × 10⁻⁶", "0.10 × 10⁻⁶": beyond six decimals,
/// and from 1e7 on, both share a power of ten. u = 0 stands as "0" beside six significant digits.
Rounded rounded(double value, double u);

/// A number of decimals: fixed(-0.5, 1) -> "−0.5", fixed(-0.01, 1) -> "0.0".
std::string fixed(double value, int decimals);
/// A number without an uncertainty: significant(0.031234, 3) -> "0.0312".
std::string significant(double value, int digits);
/// "34.0" -> "34", "1.90 × 10⁻⁶" -> "1.9 × 10⁻⁶": for a figure whose digits are known to be exact.
std::string without_end_zeros(std::string number);
/// "2.1" -> "+2.1"; zero and negative numbers as they are.
std::string with_sign(std::string number);

/// "0.8 s", "42 s", "2 min 05 s".
std::string duration(double seconds);

}  // namespace fringecal::reports
