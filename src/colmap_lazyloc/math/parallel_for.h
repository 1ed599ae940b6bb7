#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

namespace lazyloc {

// Resolves an option num_threads, where -1 means the number of cores.
int EffectiveNumThreads(int num_threads);

// Counts the threads that have no work: each group of queries runs on one thread, and the pairs of its photos on those
// without a group.
class IdleThreads {
 public:
  explicit IdleThreads(int count) : count_(count) {}

  // Takes at most `wanted` threads and returns how many there were.
  int Take(int wanted);
  void GiveBack(int count) { count_ += count; }

 private:
  std::atomic<int> count_;
};

// Holds an idle thread, if there is one, as long as it lives.
class BusyThread {
 public:
  explicit BusyThread(IdleThreads* idle_threads) : idle_threads_(*idle_threads), count_(idle_threads->Take(1)) {}
  ~BusyThread() { idle_threads_.GiveBack(count_); }
  BusyThread(const BusyThread&) = delete;
  BusyThread& operator=(const BusyThread&) = delete;

 private:
  IdleThreads& idle_threads_;
  const int count_;
};

using IndexedTask = std::function<void(size_t)>;

// Runs task(0) .. task(num_tasks - 1), each once, on the calling thread and on idle ones. A thread that finds no task
// left is idle for others at once. After an exception no new task begins, and the exception of the first task that
// failed is rethrown when the others have ended.
void ParallelFor(size_t num_tasks, const IndexedTask& task, IdleThreads* idle_threads);

// Runs task(begin, end) for ranges of 0 .. size - 1 that are worth a task each.
void ParallelForRanges(size_t size, const std::function<void(size_t begin, size_t end)>& task,
                       IdleThreads* idle_threads);

// Does the same as ParallelFor with one task object per thread, which make_task makes there: for tasks that need
// something of their own, for example a connection to a database. An exception of make_task counts after those of all
// tasks.
void ParallelForByThread(size_t num_tasks, const std::function<IndexedTask()>& make_task, IdleThreads* idle_threads);

}  // namespace lazyloc
