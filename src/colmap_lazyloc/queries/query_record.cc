#include "colmap_lazyloc/queries/query_record.h"

#include <utility>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Says in the result of a query that is not localized what was left out.
void ExplainDamages(const std::vector<std::string>& damages, LocalizationResult* result) {
  if (damages.empty() || result->status == QueryStatus::LOCALIZED) return;
  if (result->status == QueryStatus::NO_PAIRS) result->status = QueryStatus::DAMAGED_DATA;
  const std::string more = damages.size() > 1 ? " (" + std::to_string(damages.size()) + " damaged records)" : "";
  result->reason += (result->reason.empty() ? "left out: " : "; left out: ") + damages.front() + more;
}

}  // namespace

std::vector<QueryRecord> FinishRecords(LoadedGroup loaded, std::vector<LocalizationResult> results) {
  LAZYLOC_CHECK(loaded.records.size() == results.size());
  std::vector<QueryRecord> records = std::move(loaded.failures);
  for (size_t i = 0; i < results.size(); ++i) {
    QueryRecord& record = loaded.records[i];
    record.result = std::move(results[i]);
    ExplainDamages(record.damages, &record.result);
    for (const auto& [stage, seconds] : record.result.seconds) StageTimer::Add(stage, seconds, &record.seconds);
    records.push_back(std::move(record));
  }
  const double total = std::chrono::duration<double>(std::chrono::steady_clock::now() - loaded.start).count();
  for (QueryRecord& record : records) record.total_seconds = total / static_cast<double>(records.size());
  return records;
}

}  // namespace lazyloc
