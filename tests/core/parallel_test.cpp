// The threads of parallel_for: every index once, whoever calls, from wherever.
#include "core/parallel.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

namespace fringecal {
namespace {

/// The number of indices that were not handled exactly once.
int not_once(int count) {
  std::vector<std::atomic<int>> calls(static_cast<std::size_t>(count));
  parallel_for(count, [&](int i) { ++calls[static_cast<std::size_t>(i)]; });
  int wrong = 0;
  for (const std::atomic<int>& c : calls) wrong += c != 1 ? 1 : 0;
  return wrong;
}

TEST(ParallelFor, HandlesEveryIndexOnce) {
  for (const int count : {0, 1, 2, 3, 100, 10000}) EXPECT_EQ(not_once(count), 0) << count;
  for (int call = 0; call < 2000; ++call) ASSERT_EQ(not_once(3), 0);
}

TEST(ParallelFor, WorksWithinItself) {
  std::atomic<int> wrong{0};
  parallel_for(20, [&](int) { parallel_for(3, [&](int) { wrong += not_once(50); }); });
  EXPECT_EQ(wrong, 0);
}

TEST(ParallelFor, ServesSeveralThreadsAtOnce) {
  std::atomic<int> wrong{0};
  {
    std::vector<std::jthread> callers;
    for (int t = 0; t < 4; ++t) {
      callers.emplace_back([&] {
        for (int call = 0; call < 200; ++call) wrong += not_once(20);
      });
    }
  }
  EXPECT_EQ(wrong, 0);
}

TEST(ParallelFor, PassesTheFirstExceptionOnAfterAllHaveStopped) {
  for (int call = 0; call < 100; ++call) {
    std::atomic<int> at_work{0};
    EXPECT_THROW(parallel_for(50,
                              [&](int i) {
                                ++at_work;
                                if (i % 7 == 3) {
                                  --at_work;
                                  throw std::runtime_error("three");
                                }
                                --at_work;
                              }),
                 std::runtime_error);
    EXPECT_EQ(at_work, 0);
  }
  EXPECT_EQ(not_once(100), 0);
}

#if !defined(__SANITIZE_THREAD__)  // which allows a child of several threads no thread of its own
TEST(ParallelFor, WorksInAChildProcess) {
  ASSERT_EQ(not_once(100), 0);  // its threads are there
  const pid_t child = fork();
  if (child == 0) _exit(not_once(1000) == 0 && not_once(1000) == 0 ? 0 : 1);
  ASSERT_GT(child, 0);
  int status = -1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
}
#endif

}  // namespace
}  // namespace fringecal
