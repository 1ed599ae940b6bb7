#pragma once

#include <functional>
#include <string>
#include <vector>

#include "colmap_lazyloc/io/matches_output.h"
#include "colmap_lazyloc/io/photo_loader.h"
#include "colmap_lazyloc/io/problem_loader.h"
#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// What loads queries: photo_loader is null where none is a photo, matches_output where no matches are kept.
struct Loaders {
  const ProblemLoader* problem_loader = nullptr;
  const PhotoLoader* photo_loader = nullptr;
  MatchesOutput* matches_output = nullptr;
};

// Localizes the loader's queries, one group per task, on num_threads threads (-1: the number of cores); each thread has
// a database connection of its own. Threads without a group help with the pairs of photos. `report` is called for each
// result, never by two threads at once. When `should_stop` turns true no new group is begun. Results come in order of
// the groups, less those that were not begun. Damaged input that only a query meets (InputError) ends the run.
std::vector<LocalizationResult> RunQueries(const Loaders& loaders, const std::string& database_path,
                                           const LocalizerOptions& options, int num_threads,
                                           const std::function<void(const LocalizationResult&)>& report,
                                           const std::function<bool()>& should_stop);

}  // namespace lazyloc
