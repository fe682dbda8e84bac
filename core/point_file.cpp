#include "core/point_file.h"
