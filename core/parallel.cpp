#include "core/parallel.h"

#include <pthread.h>
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>

namespace fringecal {
namespace {

/// One call of parallel_for, on its caller's stack.
struct Job {
  const std::function<void(int)>& work;
  const int count;
  int places;  // for helpers that may still join
  Job* next = nullptr;
  std::atomic<int> next_index{0};
  std::atomic<int> helpers{0};  // at work
  std::mutex failure_mutex{};
  std::exception_ptr failure{};

  void run() {
    for (int i = next_index++; i < count; i = next_index++) {
      try {
        work(i);
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        if (!failure) failure = std::current_exception();
        next_index = count;
      }
    }
  }
};

/// How long a thread looks for work, or for the end of others' work, before it sleeps: some microseconds pass between
/// two passes of a fit, and waking a sleeper takes some ten. It yields to whoever else wants the processor.
template <class Condition>
void await_briefly(const Condition& condition) {
  constexpr std::chrono::microseconds kBriefly(20);
  const auto end = std::chrono::steady_clock::now() + kBriefly;
  while (!condition() && std::chrono::steady_clock::now() < end) std::this_thread::yield();
}

/// Threads that stay, for all calls: helpers join whichever call has places, so a call within a call, or calls of
/// several threads, only share them. Each caller works too and never waits for a helper that has not joined.
class Pool {
 public:
  void run(Job& job) {
    open(job);
    job.run();
    close(job);
  }

 private:
  void open(Job& job) {
    int to_wake = 0;
    {
      const std::lock_guard lock(mutex_);
      hire(job.places);
      job.next = jobs_;
      jobs_ = &job;
      places_ += job.places;
      to_wake = std::min(job.places, sleepers_);
    }
    for (; to_wake > 0; --to_wake) work_.notify_one();
  }

  /// Returns when no helper is at work on the job.
  void close(Job& job) {
    {
      const std::lock_guard lock(mutex_);
      Job** at = &jobs_;
      while (*at != &job) at = &(*at)->next;
      *at = job.next;
      places_ -= job.places;
      job.places = 0;
    }
    const auto is_done = [&] { return job.helpers == 0; };
    await_briefly(is_done);
    if (is_done()) return;
    std::unique_lock lock(mutex_);
    done_.wait(lock, is_done);
  }

  /// Threads up to `wanted`; fewer where the system gives no more.
  void hire(int wanted) {
    if (hired_ >= wanted) return;
    // Signals are for the threads that were there before; those that a thread causes itself cannot be blocked.
    sigset_t all, before;
    sigfillset(&all);
    for (const int own : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGTRAP, SIGABRT}) sigdelset(&all, own);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    try {
      for (; hired_ < wanted; ++hired_) std::thread([this] { help(); }).detach();
    } catch (const std::system_error&) {
    }
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
  }

  [[noreturn]] void help() {
    for (;;) {
      await_briefly([&] { return places_ > 0; });
      Job& job = join();
      job.run();
      const std::lock_guard lock(mutex_);
      if (--job.helpers == 0) done_.notify_all();  // the job is its caller's again
    }
  }

  Job& join() {
    std::unique_lock lock(mutex_);
    for (;;) {
      for (Job* job = jobs_; job; job = job->next) {
        if (job->places == 0) continue;
        --job->places;
        --places_;
        ++job->helpers;
        return *job;
      }
      ++sleepers_;
      work_.wait(lock);
      --sleepers_;
    }
  }

  std::mutex mutex_;
  std::condition_variable work_, done_;
  Job* jobs_ = nullptr;
  std::atomic<int> places_{0};  // of all jobs
  int hired_ = 0, sleepers_ = 0;
};

/// Never destroyed: its threads sleep in it until the process ends. A child of fork() has none of them and starts anew.
Pool& pool() {
  alignas(Pool) static std::byte place[sizeof(Pool)];
  static Pool* const made = [] {
    pthread_atfork(nullptr, nullptr, [] { new (place) Pool; });
    return new (place) Pool;
  }();
  return *made;
}

}  // namespace

int thread_count() {
  static const int count = [] {
    if (const char* set = std::getenv("FRINGECAL_THREADS")) return std::clamp(std::atoi(set), 1, 256);
    return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  }();
  return count;
}

void parallel_for(int count, const std::function<void(int)>& work) {
  const int threads = std::min(count, thread_count());
  if (threads <= 1) {
    for (int i = 0; i < count; ++i) work(i);
    return;
  }
  Job job{.work = work, .count = count, .places = threads - 1};
  pool().run(job);
  if (job.failure) std::rethrow_exception(job.failure);
}

}  // namespace fringecal
