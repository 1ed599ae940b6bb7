#include "colmap_lazyloc/math/parallel_for.h"

#include <algorithm>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace lazyloc {

int EffectiveNumThreads(int num_threads) {
  return num_threads < 1 ? static_cast<int>(std::max(1u, std::thread::hardware_concurrency())) : num_threads;
}

int IdleThreads::Take(int wanted) {
  int count = count_;
  int taken = 0;
  do {
    taken = std::max(0, std::min(wanted, count));
  } while (!count_.compare_exchange_weak(count, count - taken));
  return taken;
}

void ParallelFor(size_t num_tasks, const IndexedTask& task, IdleThreads* idle_threads) {
  ParallelForByThread(
      num_tasks, [&]() -> IndexedTask { return std::cref(task); }, idle_threads);
}

void ParallelForRanges(size_t size, const std::function<void(size_t begin, size_t end)>& task,
                       IdleThreads* idle_threads) {
  constexpr size_t kRangeSize = 64;
  ParallelFor((size + kRangeSize - 1) / kRangeSize,
              [&](size_t i) { task(i * kRangeSize, std::min((i + 1) * kRangeSize, size)); }, idle_threads);
}

void ParallelForByThread(size_t num_tasks, const std::function<IndexedTask()>& make_task, IdleThreads* idle_threads) {
  if (num_tasks == 0) return;
  std::atomic<size_t> next_task = 0;
  std::mutex error_mutex;
  std::exception_ptr error;
  size_t failed_task = num_tasks + 1;
  const auto work = [&] {
    size_t task_index = num_tasks;  // stands for make_task
    try {
      const IndexedTask task = make_task();
      while ((task_index = next_task++) < num_tasks) task(task_index);
    } catch (...) {
      next_task = num_tasks;
      const std::lock_guard<std::mutex> lock(error_mutex);
      if (task_index < failed_task) {
        failed_task = task_index;
        error = std::current_exception();
      }
    }
    idle_threads->GiveBack(1);
  };
  std::vector<std::thread> helpers;
  const int num_helpers = idle_threads->Take(static_cast<int>(num_tasks) - 1);
  helpers.reserve(num_helpers);
  try {
    while (static_cast<int>(helpers.size()) < num_helpers) helpers.emplace_back(work);
  } catch (const std::system_error&) {
    // Goes on with fewer threads, because the system has no more, for example in a container.
    idle_threads->GiveBack(num_helpers - static_cast<int>(helpers.size()));
  }
  work();
  for (std::thread& helper : helpers) helper.join();
  idle_threads->GiveBack(-1);  // the calling thread goes on
  if (error) std::rethrow_exception(error);
}

}  // namespace lazyloc
