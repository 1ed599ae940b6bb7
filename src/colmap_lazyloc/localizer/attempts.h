#pragma once

#include <vector>

#include "colmap_lazyloc/loading/query_source.h"

namespace lazyloc {

// Returns what the queries of a group are tried with, one attempt after the other, as long as one is not localized.
std::vector<Attempt> ListAttempts(const QuerySource& source, const GroupInput& input);

}  // namespace lazyloc
