#include "colmap_lazyloc/cli/query_runner.h"

#include <memory>
#include <mutex>
#include <utility>

#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/noise/database_pose_errors.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"

namespace lazyloc {

std::unique_ptr<QuerySource> MakeQuerySource(const CommandOptions& options, Model model) {
  const int seed = options.localizer.seed;
  SourceOptions source = options.source;
  // Reads no pairs if nothing corrects database poses, or if the options state their errors.
  source.reads_database_pairs = options.localizer.post_optimization == PostOptimization::TRACKS &&
                                ExpectPoseErrors(options.localizer).source == PoseNoiseSource::DEFAULT;
  return std::make_unique<QuerySource>(source, std::move(model), seed, options.num_threads);
}

std::vector<QueryRecord> LocalizeLoaded(LoadedGroup loaded, const LocalizerOptions& options) {
  std::vector<LocalizationResult> results;
  if (!loaded.group.images.empty()) results = LocalizeGroup(loaded.group, options);
  return FinishRecords(std::move(loaded), std::move(results));
}

void RunQueries(const QuerySource& source, const std::vector<size_t>& groups, const LocalizerOptions& options,
                int num_threads,
                const std::function<void(size_t group, const std::vector<QueryRecord>& records)>& finish,
                const std::function<bool()>& should_stop) {
  std::mutex finish_mutex;
  LocalizerOptions localizer = options;
  localizer.max_num_pairs = source.MaxNumPairs();
  IdleThreads idle_threads(EffectiveNumThreads(num_threads) - 1);
  const auto make_task = [&]() -> IndexedTask {
    return [&, session = std::make_shared<QuerySource::Session>(source, &idle_threads)](size_t index) {
      if (should_stop()) return;
      const size_t group = groups[index];
      const std::vector<QueryRecord> records = LocalizeLoaded(source.Load(group, session.get()), localizer);
      const std::lock_guard<std::mutex> lock(finish_mutex);
      finish(group, records);
    };
  };
  ParallelForByThread(groups.size(), make_task, &idle_threads);
}

}  // namespace lazyloc
