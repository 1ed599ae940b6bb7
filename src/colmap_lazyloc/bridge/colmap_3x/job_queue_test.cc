#include <chrono>
#include <functional>
#include <future>

#include <gtest/gtest.h>

#include "colmap/util/threading.h"

namespace lazyloc {
namespace {

// A job whose move calls a function. The queue moves a job out under its lock.
struct Job {
  Job() = default;
  explicit Job(const std::function<void()>* function) : on_move(function) {}
  Job(Job&& other) noexcept : on_move(other.on_move) {
    if (on_move != nullptr) {
      (*on_move)();
    }
  }
  const std::function<void()>* on_move = nullptr;
};

// If a queue stops without its lock, it can stop between a thread's look at the flag and the thread's wait, which then
// never ends.
TEST(JobQueue, StopsOnlyUnderItsLock) {
  colmap::JobQueue<Job> queue;
  std::future<void> stopped;
  std::future_status status_under_lock = std::future_status::ready;
  bool is_popped = false;
  const std::function<void()> on_move = [&] {
    if (is_popped && !stopped.valid()) {
      stopped = std::async(std::launch::async, [&queue] { queue.Stop(); });
      status_under_lock = stopped.wait_for(std::chrono::milliseconds(200));
    }
  };
  queue.Push(Job(&on_move));
  is_popped = true;
  queue.Pop();
  stopped.wait();
  EXPECT_EQ(status_under_lock, std::future_status::timeout);
}

}  // namespace
}  // namespace lazyloc
