#include "fitting/fit.h"
