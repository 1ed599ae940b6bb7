#include "colmap_lazyloc/localizer/attempts.h"

namespace lazyloc {

std::vector<Attempt> FurtherAttempts(const QuerySource& source, const GroupInput& input, const LoadedGroup& first) {
  std::vector<Attempt> attempts;
  if (source.HasFurtherFeatures(first)) {
    attempts.push_back(source.FirstAttempt());
    attempts.back().compares_all_features = true;
  }
  if (source.HasFallback(input)) {
    attempts.push_back(source.FirstAttempt());
    attempts.back().uses_fallback_features = true;
  }
  return attempts;
}

}  // namespace lazyloc
