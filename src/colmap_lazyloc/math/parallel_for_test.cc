#include "colmap_lazyloc/math/parallel_for.h"

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

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
