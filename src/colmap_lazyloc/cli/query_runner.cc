#include "colmap_lazyloc/cli/query_runner.h"

#include <iterator>
#include <memory>
#include <mutex>
#include <utility>

#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"

namespace lazyloc {

std::vector<QueryRecord> RunQueries(const QuerySource& source, const LocalizerOptions& options, int num_threads,
                                    const std::function<void(const QueryRecord&)>& report,
                                    const std::function<bool()>& should_stop) {
  std::vector<std::vector<QueryRecord>> records(source.NumGroups());
  std::mutex report_mutex;
  LocalizerOptions localizer = options;
  localizer.max_num_pairs = source.MaxNumPairs();
  IdleThreads idle_threads(EffectiveNumThreads(num_threads) - 1);
  const auto make_task = [&]() -> IndexedTask {
    return [&, session = std::make_shared<QuerySource::Session>(source, &idle_threads)](size_t group) {
      if (should_stop()) return;
      LoadedGroup loaded = source.Load(group, session.get());
      std::vector<LocalizationResult> results;
      if (!loaded.group.images.empty()) results = LocalizeGroup(loaded.group, localizer);
      records[group] = FinishRecords(std::move(loaded), std::move(results));
      const std::lock_guard<std::mutex> lock(report_mutex);
      for (const QueryRecord& record : records[group]) report(record);
    };
  };
  ParallelForByThread(records.size(), make_task, &idle_threads);
  std::vector<QueryRecord> finished;
  for (std::vector<QueryRecord>& group_records : records) {
    std::move(group_records.begin(), group_records.end(), std::back_inserter(finished));
  }
  return finished;
}

}  // namespace lazyloc
