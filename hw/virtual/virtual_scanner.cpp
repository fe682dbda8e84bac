#include "hw/virtual/virtual_scanner.h"
