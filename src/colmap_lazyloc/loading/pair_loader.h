#pragma once

#include <map>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/loading/loaded_group.h"
#include "colmap_lazyloc/queries/query_selection.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Loads the problem of one query at a time from the database: its keypoints and its pairs. Thread-safe with one reader
// per thread. Pairs whose records are damaged are left out. Every function throws InputError for a damaged file.
class PairLoader {
 public:
  // The selection must outlive this.
  explicit PairLoader(const QuerySelection& selection) : selection_(selection) {}

  // Loads the pairs of the pairs file, or else the num_retrieved pairs with the most verified inliers. If the database
  // has fewer of those, adds up to twice num_retrieved unverified pairs, those with the most raw matches; the localizer
  // keeps the best num_retrieved of all after it has verified them. Appends the damage of pairs that are left out to
  // `damages`. Throws DamagedRecordError if the query's own records are damaged.
  LocalizationProblem Load(const StoredQuery& query, int num_retrieved, const DatabaseReader& database,
                           std::vector<std::string>* damages) const;
  // Adds the pairs among the queries of a group: all that the database has matches for, or those of the pairs file.
  // Photos have none.
  void LoadQueryPairs(const DatabaseReader& database, LoadedGroup* loaded) const;

 private:
  // Adds pairs with the posed images among `sizes`, the one with the most matches first, to the problem until it has
  // max_num_pairs. Leaves out pairs without matches, and damaged ones, whose damage is appended to `damages`.
  void LoadPairs(const StoredQuery& query, const std::vector<PairSize>& sizes, size_t max_num_pairs,
                 const DatabaseReader& database, LocalizationProblem* problem, std::vector<std::string>* damages) const;
  // Adds the pairs of one query with earlier queries of its group, which are given by their id in the database.
  void LoadPairsWithQueries(int query_index, const std::map<uint32_t, int>& earlier_queries,
                            const DatabaseReader& database, LoadedGroup* loaded) const;

  const QuerySelection& selection_;
};

}  // namespace lazyloc
