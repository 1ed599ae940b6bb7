#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "colmap_lazyloc/cli/options.h"
#include "colmap_lazyloc/io/query_source.h"
#include "colmap_lazyloc/pipeline/options.h"

namespace lazyloc {

// Returns the source of the queries that the options name; with a model, instead of the one at input_path.
std::unique_ptr<QuerySource> MakeQuerySource(const CommandOptions& options, std::optional<Model> model = std::nullopt);

// Localizes the queries of a group that has been loaded. options: with the maximum number of pairs of its source.
std::vector<QueryRecord> LocalizeLoaded(LoadedGroup loaded, const LocalizerOptions& options);

// Localizes the source's queries, one group per task, on num_threads threads (-1: the number of cores). Threads without
// a group help with the pairs of photos. Calls `report` for each query that is done, never from two threads at once.
// Begins no new group once should_stop returns true. Returns the records in the order of the groups, without those that
// were not begun. Throws InputError for damaged input, after the groups that run have ended.
std::vector<QueryRecord> RunQueries(const QuerySource& source, const LocalizerOptions& options, int num_threads,
                                    const std::function<void(const QueryRecord&)>& report,
                                    const std::function<bool()>& should_stop);

}  // namespace lazyloc
