#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "colmap_lazyloc/cli/options.h"
#include "colmap_lazyloc/group/options.h"
#include "colmap_lazyloc/loading/query_source.h"

namespace lazyloc {

// Returns the source of the queries that the options name. model: the one at input_path.
QuerySource MakeQuerySource(const CommandOptions& options, Model model);

// Localizes the queries of a group. options: with the maximum number of pairs of its source.
std::vector<LocalizationResult> LocalizeLoaded(const LoadedGroup& loaded, const LocalizerOptions& options);

// Loads a group and localizes its queries. If some are not localized, does so by a second attempt, too; returns the
// results of the one that localizes more queries, and sets `loaded` to what it has loaded.
std::vector<LocalizationResult> LoadAndLocalize(const QuerySource& source, const GroupInput& input,
                                                const LocalizerOptions& options, QuerySource::Session* session,
                                                LoadedGroup* loaded);

// Localizes groups of the source's queries, one per task, on the threads of the options. Threads
// without a group help with the pairs of photos. Calls `finish` for each group that is done, never from two threads at
// once. Begins no new group once should_stop returns true. Throws InputError for damaged input, after the groups that
// run have ended.
void RunQueries(const QuerySource& source, const std::vector<size_t>& groups, const CommandOptions& options,
                const std::function<void(size_t group, const std::vector<QueryRecord>& records)>& finish,
                const std::function<bool()>& should_stop);

}  // namespace lazyloc
