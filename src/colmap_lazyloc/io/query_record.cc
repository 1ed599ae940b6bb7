#include "colmap_lazyloc/io/query_record.h"

#include <algorithm>
#include <utility>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Adds the times of stages; a stage that ran twice has one entry.
void AddSeconds(const StageTimer::Seconds& added, StageTimer::Seconds* seconds) {
  for (const auto& entry : added) {
    const auto known =
        std::find_if(seconds->begin(), seconds->end(), [&](const auto& other) { return other.first == entry.first; });
    if (known == seconds->end()) {
      seconds->push_back(entry);
    } else {
      known->second += entry.second;
    }
  }
}

}  // namespace

std::vector<QueryRecord> FinishRecords(LoadedGroup loaded, std::vector<LocalizationResult> results) {
  LAZYLOC_CHECK(loaded.records.size() == results.size());
  std::vector<QueryRecord> records = std::move(loaded.failures);
  for (size_t i = 0; i < results.size(); ++i) {
    QueryRecord& record = loaded.records[i];
    record.result = std::move(results[i]);
    AddSeconds(record.result.seconds, &record.seconds);
    records.push_back(std::move(record));
  }
  const double total = std::chrono::duration<double>(std::chrono::steady_clock::now() - loaded.start).count();
  for (QueryRecord& record : records) record.total_seconds = total / static_cast<double>(records.size());
  return records;
}

}  // namespace lazyloc
