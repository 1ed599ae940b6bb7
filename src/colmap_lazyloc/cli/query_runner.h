#pragma once

#include <functional>
#include <string>
#include <vector>

#include "colmap_lazyloc/io/problem_loader.h"
#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

// Localizes the loader's queries, one per task, on num_threads threads (-1: the number of cores); each thread has a
// database connection of its own. `report` is called for each result, never by two threads at once. When `should_stop`
// turns true no new query is begun. Results come in order of the queries' names, less those that were not begun.
// Damaged input that only a query meets (InputError) ends the run.
std::vector<LocalizationResult> RunQueries(const ProblemLoader& loader, const std::string& database_path,
                                           const LocalizerOptions& options, int num_threads,
                                           const std::function<void(const LocalizationResult&)>& report,
                                           const std::function<bool()>& should_stop);

}  // namespace lazyloc
