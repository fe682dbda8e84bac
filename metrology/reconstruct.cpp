#include "metrology/reconstruct.h"
