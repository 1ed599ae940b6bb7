#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/bridge/two_view_geometry.h"
#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/io/pair_loader.h"
#include "colmap_lazyloc/io/photo_loader.h"
#include "colmap_lazyloc/io/query_record.h"
#include "colmap_lazyloc/io/query_selection.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Everything that says where queries come from and what they are localized against.
struct SourceOptions {
  std::string database_path, input_path;
  int num_retrieved = 20;  // database images per query
  QuerySelectionOptions selection;
  PhotoOptions photos;

  bool Check(std::string* error) const;
};

// The queries of a run, in groups that are localized together. Whether a query is an image of the database or a photo,
// it is loaded here.
class QuerySource {
 public:
  // The readers of one thread.
  class Session;

  // verification, seed, num_threads: for photos, whose matches are verified and whose retrieval index is made here
  // (num_threads: -1 for the number of cores). Throws InputError for files and options that cannot be used.
  QuerySource(const SourceOptions& options, const TwoViewGeometryOptions& verification, int seed, int num_threads);

  size_t NumGroups() const { return selection_.Groups().size(); }
  size_t NumQueries() const { return selection_.NumQueries(); }
  // Returns the posed images that queries are localized against.
  const Model& DatabaseModel() const { return selection_.DatabaseModel(); }
  const DatabaseReader& Database() const { return database_; }
  const std::vector<std::string>& Warnings() const { return selection_.Warnings(); }
  // Returns how many pairs of a query the localizer is to use of those that are loaded; 0 for all.
  int MaxNumPairs() const { return max_num_pairs_; }
  // Loads one group. Thread-safe with one session per thread. Throws InputError for damaged data.
  LoadedGroup Load(size_t group, Session* session) const;
  // Publishes the photos' features and matches, if they are kept.
  void PublishMatches() const;

 private:
  std::optional<LocalizationProblem> LoadQuery(const std::string& name, Session* session, QueryRecord* record) const;

  DatabaseReader database_;
  QuerySelection selection_;
  PairLoader pair_loader_;
  int max_num_pairs_ = 0;
  std::unique_ptr<PhotoLoader> photo_loader_;  // null if no query is a photo
};

class QuerySource::Session {
 public:
  // idle_threads: help with the pairs of photos.
  Session(const QuerySource& source, IdleThreads* idle_threads);

 private:
  friend class QuerySource;
  DatabaseReader database_;
  std::unique_ptr<FeatureReader> features_;  // null if no query is a photo
  IdleThreads* idle_threads_;
};

}  // namespace lazyloc
