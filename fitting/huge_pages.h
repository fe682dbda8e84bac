// Large arrays in huge pages. At a million points the faults of small pages, on an array that is written once, cost as
// much as a pass of a fit.
#pragma once

#include <cstddef>

namespace fringecal::fitting {

/// Asks the system for huge pages behind the memory, before it is first written; without them it is the same memory, only
/// slower. Of less than 4 MB nothing is asked.
void prefer_huge_pages(void* memory, std::size_t bytes);

}  // namespace fringecal::fitting
