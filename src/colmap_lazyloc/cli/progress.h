#pragma once

#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "colmap_lazyloc/io/query_record.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Shows the progress of a run: a bar if the standard output is a terminal, else one JSON object a line for each query:
// {"query": name, "status": ..., "seconds": ..., "done": n, "of": N}. Warns of damaged records that were left out.
class Progress {
 public:
  explicit Progress(size_t num_queries);
  void Report(const QueryRecord& record);
  // Prints the table that ends a run.
  void PrintSummary(const std::vector<QueryRecord>& records) const;
  // Prints how well queries that were localized against the other database images agree with their poses in the model.
  static void PrintLeaveOneOut(const Model& model, const std::vector<QueryRecord>& records);

 private:
  void WarnOfDamages(const QueryRecord& record);

  const size_t num_queries_;
  const bool is_terminal_;
  size_t num_done_ = 0;
  size_t num_localized_ = 0;
  std::set<std::string> damages_;  // those that were reported
};

}  // namespace lazyloc
