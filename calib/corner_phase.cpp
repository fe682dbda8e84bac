#include "calib/board_detection.h"
