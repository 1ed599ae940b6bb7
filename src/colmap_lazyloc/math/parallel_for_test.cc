#include "colmap_lazyloc/math/parallel_for.h"

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <pthread.h>

namespace lazyloc {
namespace {

TEST(ParallelFor, RunsEachTaskOnceWhateverTheNumberOfThreads) {
  for (const int num_idle : {0, 1, 7}) {
    IdleThreads idle_threads(num_idle);
    std::vector<std::atomic<int>> runs(100);
    ParallelFor(
        runs.size(), [&](size_t i) { ++runs[i]; }, &idle_threads);
    for (const auto& count : runs) EXPECT_EQ(count, 1);
    EXPECT_EQ(idle_threads.Take(100), num_idle);
  }
}

TEST(ParallelFor, IdleThreadsHelp) {
  IdleThreads idle_threads(1);
  std::atomic<int> num_running = 0;
  // Each of the two waits for the other.
  ParallelFor(
      2,
      [&](size_t) {
        ++num_running;
        while (num_running < 2) std::this_thread::yield();
      },
      &idle_threads);
}

#ifdef __GLIBC__
TEST(ParallelFor, GoesOnWithoutThreadsThatTheSystemDoesNotGive) {
  pthread_attr_t usual, huge;
  ASSERT_EQ(pthread_getattr_default_np(&usual), 0);
  ASSERT_EQ(pthread_attr_init(&huge), 0);
  ASSERT_EQ(pthread_attr_setstacksize(&huge, size_t{1} << 46), 0);  // no address space has room for such a stack
  ASSERT_EQ(pthread_setattr_default_np(&huge), 0);
  IdleThreads idle_threads(3);
  std::atomic<int> num_runs = 0;
  ParallelFor(
      20, [&](size_t) { ++num_runs; }, &idle_threads);
  EXPECT_EQ(num_runs, 20);
  EXPECT_EQ(idle_threads.Take(100), 3);
  ASSERT_EQ(pthread_setattr_default_np(&usual), 0);
}
#endif

TEST(BusyThread, IsGivenBack) {
  IdleThreads idle_threads(1);
  for (int i = 0; i < 2; ++i) {
    const BusyThread busy(&idle_threads);
    const BusyThread none(&idle_threads);
    EXPECT_EQ(idle_threads.Take(1), 0);
  }
  EXPECT_EQ(idle_threads.Take(100), 1);
}

TEST(ParallelFor, NothingToDoRunsNothing) {
  IdleThreads idle_threads(2);
  ParallelFor(
      0, [](size_t) { FAIL(); }, &idle_threads);
}

TEST(ParallelFor, RethrowsWhatATaskThrowsAndGivesThreadsBack) {
  IdleThreads idle_threads(3);
  const auto task = [](size_t i) {
    if (i == 5) throw std::runtime_error("five");
  };
  EXPECT_THROW(ParallelFor(20, task, &idle_threads), std::runtime_error);
  EXPECT_EQ(idle_threads.Take(100), 3);
}

TEST(ParallelFor, RethrowsTheErrorOfTheFirstTaskThatFailed) {
  IdleThreads idle_threads(1);
  std::atomic<int> num_running = 0;
  const auto task = [&](size_t i) {
    ++num_running;
    while (num_running < 2) std::this_thread::yield();  // both tasks fail
    throw std::runtime_error(std::to_string(i));
  };
  try {
    ParallelFor(2, task, &idle_threads);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "0");
  }
}

TEST(ParallelFor, AThreadWithoutATaskIsIdleForOthers) {
  IdleThreads idle_threads(1);
  std::atomic<int> num_taken = 0;
  // The first task ends when it has got the thread of the second one.
  const auto task = [&](size_t i) {
    while (i == 0 && num_taken == 0) num_taken = idle_threads.Take(1);
  };
  ParallelFor(2, task, &idle_threads);
  EXPECT_EQ(num_taken, 1);
  idle_threads.GiveBack(1);
  EXPECT_EQ(idle_threads.Take(100), 1);
}

TEST(ParallelForByThread, EachThreadMakesItsOwnTaskOnce) {
  IdleThreads idle_threads(1);
  std::atomic<int> num_made = 0, num_running = 0, num_run = 0;
  const auto make_task = [&]() -> IndexedTask {
    ++num_made;
    return [&, maker = std::this_thread::get_id()](size_t) {
      EXPECT_EQ(maker, std::this_thread::get_id());
      ++num_run;
      ++num_running;
      while (num_running < 2) std::this_thread::yield();  // so that both threads have a task
    };
  };
  ParallelForByThread(20, make_task, &idle_threads);
  EXPECT_EQ(num_made, 2);
  EXPECT_EQ(num_run, 20);
}

TEST(ParallelForByThread, RethrowsWhatMakingATaskThrows) {
  IdleThreads idle_threads(2);
  const auto make_task = []() -> IndexedTask { throw std::runtime_error("cannot be opened"); };
  EXPECT_THROW(ParallelForByThread(3, make_task, &idle_threads), std::runtime_error);
  EXPECT_EQ(idle_threads.Take(100), 2);
}

TEST(IdleThreads, GivesNoMoreThanThereAre) {
  IdleThreads idle_threads(3);
  EXPECT_EQ(idle_threads.Take(2), 2);
  EXPECT_EQ(idle_threads.Take(2), 1);
  EXPECT_EQ(idle_threads.Take(2), 0);
  EXPECT_EQ(idle_threads.Take(-1), 0);
  idle_threads.GiveBack(2);
  EXPECT_EQ(idle_threads.Take(5), 2);
}

}  // namespace
}  // namespace lazyloc
