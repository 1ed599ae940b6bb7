#include "colmap_lazyloc/cli/query_runner.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include "colmap_lazyloc/pipeline/lazy_localizer.h"

namespace lazyloc {
namespace {

LocalizationResult LoadAndLocalize(const ProblemLoader& loader, const std::string& query_name,
                                   const DatabaseReader& database, const LocalizerOptions& options) {
  using Clock = std::chrono::steady_clock;
  const auto seconds_since = [](Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  const Clock::time_point start = Clock::now();
  const LocalizationProblem problem = loader.Load(query_name, database);
  const double load_seconds = seconds_since(start);
  LocalizationResult result = LocalizeQuery(problem, options);
  result.seconds.insert(result.seconds.begin(), {"load", load_seconds});
  result.seconds.emplace_back("total", seconds_since(start));
  return result;
}

int EffectiveNumThreads(int num_threads, size_t num_queries) {
  if (num_threads < 1) num_threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  return static_cast<int>(std::min<size_t>(num_threads, num_queries));
}

}  // namespace

std::vector<LocalizationResult> RunQueries(const ProblemLoader& loader, const std::string& database_path,
                                           const LocalizerOptions& options, int num_threads,
                                           const std::function<void(const LocalizationResult&)>& report,
                                           const std::function<bool()>& should_stop) {
  const std::vector<std::string>& names = loader.QueryNames();
  std::vector<std::optional<LocalizationResult>> results(names.size());
  std::vector<std::exception_ptr> errors(names.size() + 1);
  std::atomic<size_t> next_query = 0;
  std::atomic<bool> failed = false;
  std::mutex report_mutex;
  const auto work = [&] {
    size_t query = names.size();  // opening the database has the last slot
    try {
      const DatabaseReader database(database_path);
      while (!failed && !should_stop() && (query = next_query++) < names.size()) {
        results[query] = LoadAndLocalize(loader, names[query], database, options);
        const std::lock_guard<std::mutex> lock(report_mutex);
        report(*results[query]);
      }
    } catch (...) {
      errors[std::min(query, names.size())] = std::current_exception();
      failed = true;
    }
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < EffectiveNumThreads(num_threads, names.size()); ++i) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
  std::vector<LocalizationResult> finished;
  for (std::optional<LocalizationResult>& result : results) {
    if (result) finished.push_back(std::move(*result));
  }
  return finished;
}

}  // namespace lazyloc
