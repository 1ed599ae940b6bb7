#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/features/coarse_features.h"
#include "colmap_lazyloc/features/extracted_features.h"
#include "colmap_lazyloc/features/feature_statistics.h"
#include "colmap_lazyloc/features/pair_matching.h"
#include "colmap_lazyloc/features/retrieval_index.h"
#include "colmap_lazyloc/formats/query_files.h"
#include "colmap_lazyloc/loading/attempt.h"
#include "colmap_lazyloc/loading/database_candidate.h"
#include "colmap_lazyloc/loading/fallback_features.h"
#include "colmap_lazyloc/loading/matches_output.h"
#include "colmap_lazyloc/loading/photo_options.h"
#include "colmap_lazyloc/queries/photo_camera.h"
#include "colmap_lazyloc/queries/query_selection.h"
#include "colmap_lazyloc/scene/query_prior.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

// Makes the localization problem of a photo in memory: extracts features like the database's, chooses database images,
// matches and verifies. A photo that this does not localize can be loaded again, with all features compared, or with
// fallback features.
class PhotoLoader {
 public:
  // num_threads: for making the retrieval index. The selection must outlive this. Throws InputError for files that
  // cannot be used, if no posed image has descriptors, and if photos cannot have such features.
  PhotoLoader(const DatabaseReader& database, const QuerySelection& selection, const PhotoOptions& options, int seed,
              int num_threads);

  // Returns the database images near a photo; none if it needs them all, or retrieval finds them faster.
  DatabaseCandidates FindNear(const PhotoQuery& photo, const std::optional<PositionPrior>& position) const;
  // Makes the retrieval index, if a photo that is not compared with near images needs it. Load does it, too.
  void PrepareRetrieval(const PhotoQuery& photo) const {
    if (NeedsRetrieval(photo)) Index();
  }
  // near: the database images to choose from; empty: from all. Adds keypoints and times to the record. Throws Refusal
  // if the photo cannot be used. Leaves out database images whose features are damaged, and says so in the record.
  // Throws InputError for a damaged file. Thread-safe with one reader per thread; the result depends only on the input.
  LocalizationProblem Load(const PhotoQuery& photo, const Attempt& attempt, const DatabaseCandidates& near,
                           const FeatureReader& features, IdleThreads* idle_threads, QueryRecord* record) const;
  // True if an attempt that compares all features may find more than the one that gave this problem.
  bool HasFurtherFeatures(const LocalizationProblem& problem, const QueryRecord& record) const {
    return record.matcher == methods_.database->Matcher() && lazyloc::HasFurtherFeatures(*methods_.database, problem);
  }
  // True if photos that are not localized can be loaded once more.
  bool HasFallback() const { return fallback_ && !methods_.is_fallback_first; }
  // Loads a photo with fallback features. first: what Load has returned; seconds add up in the record.
  LocalizationProblem LoadFallback(const PhotoQuery& photo, const LocalizationProblem& first,
                                   const FeatureReader& features, IdleThreads* idle_threads, QueryRecord* record) const;
  // Matches a database image with those of the nearest viewpoints, and verifies the matches. Returns pairs with enough
  // of them. Leaves out images whose features are damaged.
  std::vector<ImagePair> MatchDatabaseImage(const ModelImage& image, int max_num_others, const FeatureReader& features,
                                            IdleThreads* idle_threads) const;
  // True if the keypoints of the database images of a photo are those of the database.
  bool HasStoredKeypoints(const QueryRecord& record) const {
    return !fallback_ || fallback_->HasStoredKeypoints() || record.matcher == methods_.database->Matcher();
  }
  // Returns the keypoints of a database image whose features were extracted on demand; empty for all others.
  std::vector<Eigen::Vector2d> ExtractedKeypoints(const std::string& image_name) const;
  // Returns one line for each problem that does not end the run.
  std::vector<std::string> Warnings() const;
  // Returns how the features of photos are extracted, for a photo like the database images.
  std::string DescribeExtraction() const;
  // Publishes the database at matches_output_path, if there is one.
  void PublishMatches() const {
    if (matches_output_) matches_output_->Publish();
  }

 private:
  using Candidate = DatabaseCandidate;
  using Candidates = DatabaseCandidates;

  // Sets the candidates. counts: of the descriptors in the database.
  void FindCandidates(const DescriptorCounts& counts);
  // Returns the index, which the first call makes: of coarse features if features are extracted on demand.
  const RetrievalIndex& Index() const;
  std::unique_ptr<RetrievalIndex> MakeIndex() const;
  // Sets what extracts and matches features like those of the database.
  void ChooseMethods(FeatureType type, const FeatureReader& reader);
  // Throws Refusal if the file is not a readable image.
  PhotoFile ReadFile(const PhotoQuery& photo, const FeatureMethod& method, QueryRecord* record) const;
  // Sets the statistics of the candidates' features.
  void MeasureCandidates(const std::map<uint32_t, size_t>& num_descriptors, const FeatureReader& reader);
  // Reads or extracts the features of a database image. Throws DamagedRecordError.
  Features Read(const Candidate& candidate, const FeatureReader& features) const;
  // Returns the features of candidates that are not stored; null for others, and for those that cannot be extracted.
  DatabaseFeatures ExtractOnDemand(const Candidates& candidates, const FeatureReader& features,
                                   IdleThreads* idle_threads) const;
  // Returns the features of a database image; null if they are damaged.
  std::shared_ptr<const Features> FeaturesOf(const Candidate& candidate, const FeatureReader& features) const;
  // Returns the candidates that the pairs file lists, or all.
  Candidates AllowedCandidates(const PhotoQuery& photo) const;
  Candidates ChooseCandidates(const PhotoQuery& photo, const Candidates& near, const Features& features,
                              size_t num_retrieved, IdleThreads* idle_threads) const;
  // Returns the candidates whose coarse features match the photo's best.
  Candidates ChooseMostAlike(const Candidates& near, const Features& features, size_t num_retrieved,
                             IdleThreads* idle_threads) const;
  bool NeedsRetrieval(const PhotoQuery& photo) const;
  // Adds the candidates' pairs to the problem and returns their features, but those that are damaged.
  DatabaseFeatures AddPairs(const Candidates& candidates, const FeatureReader& features, IdleThreads* idle_threads,
                            LocalizationProblem* problem, QueryRecord* record) const;

  const QuerySelection& selection_;
  const PhotoOptions options_;
  const int seed_;
  const int num_threads_;
  const std::filesystem::path database_path_;
  const DefaultCamera default_camera_;
  std::vector<Candidate> candidates_;  // sorted by name
  FeatureMethods methods_;
  std::optional<ExtractedFeatures> extracted_;        // of candidates that are not stored; nullopt if all must be
  std::optional<CoarseExtraction> coarse_;            // then
  std::unique_ptr<const FallbackFeatures> fallback_;  // null without methods_.fallback
  std::unique_ptr<MatchesOutput> matches_output_;
  FeatureStatistics statistics_;  // of the candidates
  PhotoScale database_scale_;     // medians over the candidates
  std::vector<std::string> warnings_;
  mutable std::mutex index_mutex_;
  mutable std::unique_ptr<const RetrievalIndex> index_;  // null until a photo needs it
  mutable LruCache<Features> features_;
  mutable LruCache<std::optional<Features>> coarse_features_;
};

}  // namespace lazyloc
