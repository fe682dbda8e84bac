#include "calib/align.h"
