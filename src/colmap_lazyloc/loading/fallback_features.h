#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/features/extracted_features.h"
#include "colmap_lazyloc/features/feature_method.h"
#include "colmap_lazyloc/loading/database_candidate.h"
#include "colmap_lazyloc/loading/photo_options.h"
#include "colmap_lazyloc/queries/query_selection.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

using DatabaseFeatures = std::vector<std::shared_ptr<const Features>>;

// Matches photos that the features of the database do not localize by those of another method, with the few database
// images that look most like them. Database images that have other features in the database are extracted from their
// files.
class FallbackFeatures {
 public:
  // The selection and the method must outlive this. database_type: of the features in the database.
  FallbackFeatures(const QuerySelection& selection, const PhotoOptions& options, const FeatureMethod& method,
                   FeatureType database_type, int seed);

  // Returns the problem of a photo, and sets keypoints and times of the record. first: the problem of the first
  // attempt, whose intrinsics and priors are kept. candidates: sorted by name; those whose file is not at hand or whose
  // record is damaged are left out. Thread-safe with one reader per thread; the result depends only on the input.
  LocalizationProblem Load(const PhotoFile& photo, const LocalizationProblem& first,
                           const DatabaseCandidates& candidates, const FeatureReader& reader, IdleThreads* idle_threads,
                           QueryRecord* record) const;
  // True if the keypoints of database images are those of the database.
  bool HasStoredKeypoints() const { return !extracted_; }
  bool HasFile(const DatabaseCandidate& candidate) const {
    return !extracted_ || extracted_->HasFile(candidate.image->name);
  }

 private:
  // Returns null for images without usable features.
  DatabaseFeatures ReadFeatures(const DatabaseCandidates& candidates, const FeatureReader& reader,
                                IdleThreads* idle_threads) const;

  const QuerySelection& selection_;
  const int seed_;
  const FeatureMethod& method_;
  std::optional<ExtractedFeatures> extracted_;  // nullopt if the database has such features
  mutable LruCache<std::optional<Features>> features_;
};

}  // namespace lazyloc
