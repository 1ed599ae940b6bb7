#include "colmap_lazyloc/pipeline/lazy_localizer.h"

#include <utility>

#include "colmap_lazyloc/pipeline/make_record.h"
#include "colmap_lazyloc/pipeline/solve_group.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

std::vector<LocalizationResult> LocalizeGroup(const QueryGroup& group, const LocalizerOptions& options) {
  std::string error;
  if (!options.Check(&error)) throw InputError(error);
  return MakeResults(SolveGroup(group, options), options);
}

LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options) {
  QueryGroup group;
  group.frame_names = {""};
  group.images.push_back({problem, 0, {}});
  return std::move(LocalizeGroup(group, options).front());
}

}  // namespace lazyloc
