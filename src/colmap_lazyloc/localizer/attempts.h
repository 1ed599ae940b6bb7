#pragma once

#include <vector>

#include "colmap_lazyloc/loading/query_source.h"

namespace lazyloc {

// Returns what the queries of a group are tried with after the first attempt, one attempt after the other, as long as
// one is not localized. loaded: what the first attempt has loaded.
std::vector<Attempt> FurtherAttempts(const QuerySource& source, const GroupInput& input, const Attempt& first,
                                     const LoadedGroup& loaded);

}  // namespace lazyloc
