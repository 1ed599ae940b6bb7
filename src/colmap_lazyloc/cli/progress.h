#pragma once

#include <cstddef>
#include <vector>

#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Shows how a run goes: a progress bar where the standard output is a terminal, elsewhere one JSON object a line per
// query: {"query": name, "status": ..., "seconds": ..., "done": n, "of": N}.
class Progress {
 public:
  explicit Progress(size_t num_queries);
  void Report(const LocalizationResult& result);
  // The table that ends a run.
  void PrintSummary(const std::vector<LocalizationResult>& results) const;

 private:
  const size_t num_queries_;
  const bool is_terminal_;
  size_t num_done_ = 0;
  size_t num_localized_ = 0;
};

}  // namespace lazyloc
