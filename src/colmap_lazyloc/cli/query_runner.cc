#include "colmap_lazyloc/cli/query_runner.h"

#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>

#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/noise/database_pose_errors.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"

namespace lazyloc {
namespace {

size_t CountLocalized(const std::vector<LocalizationResult>& results) {
  return std::count_if(results.begin(), results.end(),
                       [](const LocalizationResult& result) { return result.status == QueryStatus::LOCALIZED; });
}

}  // namespace

QuerySource MakeQuerySource(const CommandOptions& options, Model model) {
  SourceOptions source = options.source;
  // Reads no pairs if nothing corrects database poses, or if the options state their errors.
  source.reads_database_pairs = options.localizer.method == Method::EXTENDED &&
                                ExpectPoseErrors(options.localizer).source == PoseNoiseSource::DEFAULT;
  return QuerySource(source, std::move(model), options.localizer.seed, options.num_threads);
}

std::vector<LocalizationResult> LocalizeLoaded(const LoadedGroup& loaded, const LocalizerOptions& options) {
  if (loaded.group.images.empty()) return {};
  return LocalizeGroup(loaded.group, options);
}

std::vector<LocalizationResult> LoadAndLocalize(const QuerySource& source, const GroupInput& input,
                                                const LocalizerOptions& options, QuerySource::Session* session,
                                                LoadedGroup* loaded) {
  *loaded = source.Load(input, session);
  std::vector<LocalizationResult> results = LocalizeLoaded(*loaded, options);
  const size_t num_localized = CountLocalized(results);
  if (num_localized == results.size()) return results;
  std::optional<LoadedGroup> again = source.LoadAgain(input, *loaded, session);
  if (!again) return results;
  std::vector<LocalizationResult> second = LocalizeLoaded(*again, options);
  const bool is_better = CountLocalized(second) > num_localized;
  // Counts the time of both attempts, whichever is kept.
  for (size_t i = 0; i < results.size(); ++i) {
    const LocalizationResult& other = is_better ? results[i] : second[i];
    for (const auto& [stage, seconds] : other.seconds) StageTimer::Add(stage, seconds, &again->records[i].seconds);
    if (!is_better) loaded->records[i].seconds = again->records[i].seconds;
  }
  if (!is_better) return results;
  *loaded = *std::move(again);
  return second;
}

void RunQueries(const QuerySource& source, const std::vector<size_t>& groups, const CommandOptions& options,
                const std::function<void(size_t group, const std::vector<QueryRecord>& records)>& finish,
                const std::function<bool()>& should_stop) {
  std::mutex finish_mutex;
  LocalizerOptions localizer = options.localizer;
  localizer.max_num_pairs = source.MaxNumPairs();
  IdleThreads idle_threads(EffectiveNumThreads(options.num_threads) - 1);
  const auto make_task = [&]() -> IndexedTask {
    return [&, session = std::make_shared<QuerySource::Session>(source, &idle_threads)](size_t index) {
      if (should_stop()) return;
      const size_t group = groups[index];
      LoadedGroup loaded;
      std::vector<LocalizationResult> results =
          LoadAndLocalize(source, source.Group(group), localizer, session.get(), &loaded);
      const std::vector<QueryRecord> records = FinishRecords(std::move(loaded), std::move(results));
      const std::lock_guard<std::mutex> lock(finish_mutex);
      finish(group, records);
    };
  };
  ParallelForByThread(groups.size(), make_task, &idle_threads);
}

}  // namespace lazyloc
