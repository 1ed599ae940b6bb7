#include "colmap_lazyloc/math/parallel_for.h"

#include <algorithm>
#include <exception>
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

void ParallelFor(size_t num_tasks, const std::function<void(size_t)>& task, IdleThreads* idle_threads) {
  if (num_tasks == 0) return;
  std::atomic<size_t> next_task = 0;
  std::vector<std::exception_ptr> errors(num_tasks);
  const auto work = [&] {
    size_t task_index = next_task++;
    try {
      for (; task_index < num_tasks; task_index = next_task++) task(task_index);
    } catch (...) {
      errors[task_index] = std::current_exception();
      next_task = num_tasks;
    }
  };
  const int num_helpers = idle_threads->Take(static_cast<int>(num_tasks) - 1);
  std::vector<std::thread> helpers;
  for (int i = 0; i < num_helpers; ++i) helpers.emplace_back(work);
  work();
  for (std::thread& helper : helpers) helper.join();
  idle_threads->GiveBack(num_helpers);
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace lazyloc
