#include "calib/model/chen2008.h"
