#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

namespace lazyloc {

// Of an option num_threads, where -1 stands for the number of cores.
int EffectiveNumThreads(int num_threads);

// Threads that nobody uses at the moment: queries run one per thread, and a query's pairs also on those left over.
class IdleThreads {
 public:
  explicit IdleThreads(int count) : count_(count) {}

  // As many as there are, at most `wanted`.
  int Take(int wanted);
  void GiveBack(int count) { count_ += count; }

 private:
  std::atomic<int> count_;
};

// Runs task(0) .. task(num_tasks - 1), each once, on the calling thread and on idle ones. Rethrows the exception of the
// first task that failed.
void ParallelFor(size_t num_tasks, const std::function<void(size_t)>& task, IdleThreads* idle_threads);

}  // namespace lazyloc
