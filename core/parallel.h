// parallel_for: the same work whatever the number of threads. Each index is handled by exactly one call, so a result
// written per index does not depend on the thread count; sums over indices are the caller's, in a fixed order.
//
// The threads stay between calls: they look for work for 20 us, as long as a fit takes between two passes, then sleep.
// Signals are not theirs. Calls within calls and calls of several threads share them; a child of fork() gets its own.
#pragma once

#include <functional>

namespace fringecal {

/// Threads to use: FRINGECAL_THREADS if set, else the hardware's.
int thread_count();

/// Calls work(i) for i in [0, count), on up to thread_count() threads. The first exception is rethrown after all
/// stopped.
void parallel_for(int count, const std::function<void(int)>& work);

}  // namespace fringecal
