#include "colmap_lazyloc/cli/query_runner.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <iterator>
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

// A query with what loading it took; `failure` where there is no problem to be solved.
struct LoadedQuery {
  LocalizationProblem problem;
  StageTimer::Seconds seconds;
  std::optional<PhotoFailure> failure;
};

LoadedQuery LoadPhoto(const Loaders& loaders, const PhotoQuery& photo, const Readers& readers,
                      IdleThreads* idle_threads) {
  LoadedQuery query;
  try {
    LoadedPhoto loaded = loaders.photo_loader->Load(photo, *readers.features, idle_threads, &query.seconds);
    if (loaders.matches_output != nullptr) {
      const StageTimer timer("matches_output", &query.seconds);
      loaders.matches_output->Write(loaded.problem, *loaded.features, loaded.database_features);
    }
    query.problem = std::move(loaded.problem);
  } catch (const PhotoFailure& failure) {
    query.problem.query_name = photo.name;
    query.failure = failure;
  }
  return query;
}

LoadedQuery LoadQuery(const Loaders& loaders, const std::string& name, const Readers& readers,
                      IdleThreads* idle_threads) {
  const auto& photos = loaders.problem_loader->Photos();
  if (const auto photo = photos.find(name); photo != photos.end()) {
    return LoadPhoto(loaders, photo->second, readers, idle_threads);
  }
  LoadedQuery query;
  {
    const StageTimer timer("load", &query.seconds);
    query.problem = loaders.problem_loader->Load(name, readers.database);
  }
  return query;
}

LocalizationResult ResultOf(const LoadedQuery& query) {
  LocalizationResult result;
  result.query_name = query.problem.query_name;
  result.status = query.failure->status;
  result.reason = query.failure->reason;
  result.seconds = query.seconds;
  return result;
}

// Photos that cannot be used are left out of their group.
std::vector<LocalizationResult> LoadAndLocalize(const Loaders& loaders, const QueryFrames& frames,
                                                const Readers& readers, const LocalizerOptions& options,
                                                IdleThreads* idle_threads) {
  std::vector<LocalizationResult> results;
  QueryGroup group;
  std::vector<StageTimer::Seconds> seconds;
  for (const QueryFrame& frame : frames) {
    const int frame_index = static_cast<int>(group.frame_names.size());
    for (const QueryFrame::Image& image : frame.images) {
      LoadedQuery query = LoadQuery(loaders, image.name, readers, idle_threads);
      if (query.failure) {
        results.push_back(ResultOf(query));
        continue;
      }
      seconds.push_back(std::move(query.seconds));
      group.images.push_back({std::move(query.problem), frame_index, image.cam_from_rig});
    }
    if (!group.images.empty() && group.images.back().frame == frame_index) group.frame_names.push_back(frame.name);
  }
  if (group.images.empty()) return results;
  loaders.problem_loader->LoadQueryPairs(readers.database, &group);
  std::vector<LocalizationResult> localized = LocalizeGroup(group, options);
  for (size_t i = 0; i < localized.size(); ++i) {
    LocalizationProblem& problem = group.images[i].problem;
    if (loaders.problem_loader->Photos().count(problem.query_name) > 0) {
      localized[i].photo_keypoints = std::move(problem.query_keypoints);
    }
    localized[i].seconds.insert(localized[i].seconds.begin(), seconds[i].begin(), seconds[i].end());
    results.push_back(std::move(localized[i]));
  }
  return results;
}

// `total`: each query's share of the group's time.
void AddTotal(double group_seconds, std::vector<LocalizationResult>* results) {
  for (LocalizationResult& result : *results) {
    result.seconds.emplace_back("total", group_seconds / static_cast<double>(results->size()));
  }
}

}  // namespace

std::vector<LocalizationResult> RunQueries(const Loaders& loaders, const std::string& database_path,
                                           const LocalizerOptions& options, int num_threads,
                                           const std::function<void(const LocalizationResult&)>& report,
                                           const std::function<bool()>& should_stop) {
  const std::vector<QueryFrames>& groups = loaders.problem_loader->Groups();
  std::vector<std::vector<LocalizationResult>> results(groups.size());
  std::vector<std::exception_ptr> errors(groups.size() + 1);
  std::atomic<size_t> next_group = 0;
  std::atomic<bool> failed = false;
  std::mutex report_mutex;
  const int num_workers = static_cast<int>(std::min<size_t>(EffectiveNumThreads(num_threads), groups.size()));
  IdleThreads idle_threads(EffectiveNumThreads(num_threads) - num_workers);
  const auto work = [&] {
    size_t group = groups.size();  // opening the database has the last slot
    try {
      const Readers readers(loaders, database_path);
      while (!failed && !should_stop() && (group = next_group++) < groups.size()) {
        const auto start = std::chrono::steady_clock::now();
        results[group] = LoadAndLocalize(loaders, groups[group], readers, options, &idle_threads);
        AddTotal(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), &results[group]);
        const std::lock_guard<std::mutex> lock(report_mutex);
        for (const LocalizationResult& result : results[group]) report(result);
      }
    } catch (...) {
      errors[std::min(group, groups.size())] = std::current_exception();
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
  for (std::vector<LocalizationResult>& of_group : results) {
    std::move(of_group.begin(), of_group.end(), std::back_inserter(finished));
  }
  return finished;
}

}  // namespace lazyloc
