#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// How many queries a run has, or one shard of it.
struct RunSize {
  size_t num_queries = 0;        // of this shard
  size_t num_done = 0;           // by an earlier process
  size_t num_other_queries = 0;  // of the other shards
};

// Shows the progress of a run. The standard output gets one JSON object a line for each query:
// {"query": name, "status": ..., "confidence": ..., "position": ..., "seconds": ..., "done": n, "of": N,
// "seconds_left": ...}. The standard error output gets words for people: warnings of damaged records that were left
// out, a summary, and on a terminal a bar, unless the lines are for another program. The bar takes the place of lines
// on a terminal. A log gets the lines in any case.
class Progress {
 public:
  // log_path: empty for no log. append_log: true to keep what the log holds. Throws InputError if the log cannot be
  // opened.
  Progress(const RunSize& size, const std::filesystem::path& log_path, bool append_log);
  // Throws InputError if the log cannot be written.
  void Report(const QueryRecord& record);
  // Prints the table that ends a run to the standard error output, and how long what is left would take. Returns true
  // if all of the records are of localized queries.
  bool PrintSummary(const QueryRecords& records) const;

 private:
  void WarnOfDamages(const QueryRecord& record);
  std::string Line(const QueryRecord& record) const;
  // Returns an estimate for the queries of this run that are left.
  double SecondsLeft() const;

  const RunSize size_;
  const bool has_bar_, has_lines_;
  const std::filesystem::path log_path_;
  std::ofstream log_;
  size_t num_done_ = 0;
  size_t num_localized_ = 0;       // by this process
  std::set<std::string> damages_;  // those that were reported
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace lazyloc
