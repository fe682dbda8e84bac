#include "calib/decode/decode.h"
