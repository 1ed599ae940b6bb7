#include "colmap_lazyloc/localizer/attempts.h"

namespace lazyloc {

std::vector<Attempt> ListAttempts(const QuerySource& source, const GroupInput& input) {
  std::vector<Attempt> attempts = {source.FirstAttempt()};
  if (source.HasFallback(input)) {
    attempts.push_back(attempts.front());
    attempts.back().uses_fallback_features = true;
  }
  return attempts;
}

}  // namespace lazyloc
