#include "colmap_lazyloc/cli/query_runner.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "colmap_lazyloc/pipeline/lazy_localizer.h"

namespace lazyloc {
namespace {

// What a thread loads queries with.
struct Readers {
  Readers(const Loaders& loaders, const std::string& database_path) : database(database_path) {
    if (loaders.photo_loader != nullptr) features = std::make_unique<FeatureReader>(database_path);
  }

  DatabaseReader database;
  std::unique_ptr<FeatureReader> features;
};

LocalizationResult LocalizePhoto(const Loaders& loaders, const PhotoQuery& photo, const Readers& readers,
                                 const LocalizerOptions& options, IdleThreads* idle_threads) {
  StageTimer::Seconds seconds;
  LocalizationResult result;
  try {
    LoadedPhoto loaded = loaders.photo_loader->Load(photo, *readers.features, idle_threads, &seconds);
    loaders.problem_loader->LoadDatabaseMatches(readers.database, &loaded.problem);
    if (loaders.matches_output != nullptr) {
      const StageTimer timer("matches_output", &seconds);
      loaders.matches_output->Write(loaded.problem, *loaded.features, loaded.database_features);
    }
    result = LocalizeQuery(loaded.problem, options);
    result.photo_keypoints = std::move(loaded.problem.query_keypoints);
  } catch (const PhotoFailure& failure) {
    result.query_name = photo.name;
    result.status = failure.status;
    result.reason = failure.reason;
  }
  result.seconds.insert(result.seconds.begin(), seconds.begin(), seconds.end());
  return result;
}

LocalizationResult LoadAndLocalize(const Loaders& loaders, const std::string& query_name, const Readers& readers,
                                   const LocalizerOptions& options, IdleThreads* idle_threads) {
  using Clock = std::chrono::steady_clock;
  const auto seconds_since = [](Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  const Clock::time_point start = Clock::now();
  LocalizationResult result;
  const auto& photos = loaders.problem_loader->Photos();
  if (const auto photo = photos.find(query_name); photo != photos.end()) {
    result = LocalizePhoto(loaders, photo->second, readers, options, idle_threads);
  } else {
    const LocalizationProblem problem = loaders.problem_loader->Load(query_name, readers.database);
    const double load_seconds = seconds_since(start);
    result = LocalizeQuery(problem, options);
    result.seconds.insert(result.seconds.begin(), {"load", load_seconds});
  }
  result.seconds.emplace_back("total", seconds_since(start));
  return result;
}

}  // namespace

std::vector<LocalizationResult> RunQueries(const Loaders& loaders, const std::string& database_path,
                                           const LocalizerOptions& options, int num_threads,
                                           const std::function<void(const LocalizationResult&)>& report,
                                           const std::function<bool()>& should_stop) {
  const std::vector<std::string>& names = loaders.problem_loader->QueryNames();
  std::vector<std::optional<LocalizationResult>> results(names.size());
  std::vector<std::exception_ptr> errors(names.size() + 1);
  std::atomic<size_t> next_query = 0;
  std::atomic<bool> failed = false;
  std::mutex report_mutex;
  const int num_workers = static_cast<int>(std::min<size_t>(EffectiveNumThreads(num_threads), names.size()));
  IdleThreads idle_threads(EffectiveNumThreads(num_threads) - num_workers);
  const auto work = [&] {
    size_t query = names.size();  // opening the database has the last slot
    try {
      const Readers readers(loaders, database_path);
      while (!failed && !should_stop() && (query = next_query++) < names.size()) {
        results[query] = LoadAndLocalize(loaders, names[query], readers, options, &idle_threads);
        const std::lock_guard<std::mutex> lock(report_mutex);
        report(*results[query]);
      }
    } catch (...) {
      errors[std::min(query, names.size())] = std::current_exception();
      failed = true;
    }
    idle_threads.GiveBack(1);
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < num_workers; ++i) threads.emplace_back(work);
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
