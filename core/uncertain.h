// A value with its standard uncertainty, in the letters of the GUM.
#pragma once

namespace fringecal {

/// value and u (standard uncertainty, k = 1), both in the unit that the variable's name carries.
struct Uncertain {
  double value = 0.0;
  double u = 0.0;
};

}  // namespace fringecal
