#include "fitting/huge_pages.h"

#include <sys/mman.h>

#include <cstdint>

namespace fringecal::fitting {

void prefer_huge_pages(void* memory, std::size_t bytes) {
#ifdef MADV_HUGEPAGE
  constexpr std::uintptr_t kHuge = std::uintptr_t{2} << 20;
  if (bytes < 2 * kHuge) return;
  // The whole huge pages within the memory.
  const std::size_t before = (kHuge - reinterpret_cast<std::uintptr_t>(memory) % kHuge) % kHuge;
  madvise(static_cast<char*>(memory) + before, (bytes - before) / kHuge * kHuge, MADV_HUGEPAGE);
#else
  (void)memory;
  (void)bytes;
#endif
}

}  // namespace fringecal::fitting
