#pragma once

#include <vector>

#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/query_record.h"
#include "colmap_lazyloc/scene/query_status.h"

namespace lazyloc {

// A query that cannot be loaded.
struct RefusedQuery {
  QueryRecord record;
  Refusal refusal;
};

// A group that is ready to be localized, and what loading knows of its queries.
struct LoadedGroup {
  QueryGroup group;
  std::vector<QueryRecord> records;   // one per image of the group, in the same order
  std::vector<RefusedQuery> refused;  // queries that are not in the group
};

}  // namespace lazyloc
