#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/queries/query_record.h"
#include "colmap_lazyloc/queries/query_selection.h"
#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Loads the problem of one query at a time from the database: its keypoints and its pairs. Thread-safe with one reader
// per thread. Pairs whose records are damaged are left out. Every function throws InputError for a damaged file.
class PairLoader {
 public:
  // num_retrieved: database images per query, unless a pairs file lists them. The selection must outlive this.
  PairLoader(const QuerySelection& selection, int num_retrieved)
      : selection_(selection), num_retrieved_(static_cast<size_t>(num_retrieved)) {}

  // Loads the pairs of the pairs file, or else the num_retrieved pairs with the most verified inliers. If the database
  // has fewer of those, adds up to twice num_retrieved unverified pairs, those with the most raw matches; the localizer
  // keeps the best num_retrieved of all after it has verified them. Appends the damage of pairs that are left out to
  // `damages`. Throws DamagedRecordError if the query's own records are damaged.
  LocalizationProblem Load(const StoredQuery& query, const DatabaseReader& database,
                           std::vector<std::string>* damages) const;
  // Adds the pairs among the queries of a group: all that the database has matches for, or those of the pairs file.
  // Photos have none.
  void LoadQueryPairs(const DatabaseReader& database, LoadedGroup* loaded) const;

 private:
  struct Candidate {
    const ModelImage* image = nullptr;
    uint32_t image_id = 0;  // in the database
    int num_matches = 0;    // verified or raw
  };
  using Candidates = std::vector<Candidate>;

  // Returns the posed images among `sizes`, the one with the most matches first.
  Candidates RankCandidates(const StoredQuery& query, const std::vector<PairSize>& sizes) const;
  // Adds pairs with the candidates to the problem until it has max_num_pairs.
  void LoadPairs(const StoredQuery& query, const Candidates& candidates, size_t max_num_pairs,
                 const DatabaseReader& database, LocalizationProblem* problem, std::vector<std::string>* damages) const;
  void LoadBestPairs(const StoredQuery& query, const DatabaseReader& database, LocalizationProblem* problem,
                     std::vector<std::string>* damages) const;
  // Returns nullopt if there is no such pair with matches, or it is damaged, which is then appended to `damages`.
  std::optional<ImagePair> LoadPair(const StoredQuery& query, const Candidate& candidate,
                                    const LocalizationProblem& problem, const DatabaseReader& database,
                                    std::vector<std::string>* damages) const;
  // Adds the pairs of one query with earlier queries of its group, which are given by their id in the database.
  void LoadPairsWithQueries(int query_index, const std::map<uint32_t, int>& earlier_queries,
                            const DatabaseReader& database, LoadedGroup* loaded) const;
  std::vector<uint32_t> PairedImageIds(const StoredQuery& query, const std::vector<uint32_t>& other_ids,
                                       const DatabaseReader& database) const;

  const QuerySelection& selection_;
  const size_t num_retrieved_;
};

}  // namespace lazyloc
