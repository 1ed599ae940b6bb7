#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/features/extracted_features.h"
#include "colmap_lazyloc/features/feature_statistics.h"
#include "colmap_lazyloc/features/pair_matching.h"
#include "colmap_lazyloc/features/retrieval_index.h"
#include "colmap_lazyloc/formats/query_files.h"
#include "colmap_lazyloc/loading/attempt.h"
#include "colmap_lazyloc/loading/fallback_features.h"
#include "colmap_lazyloc/loading/matches_output.h"
#include "colmap_lazyloc/loading/photo_options.h"
#include "colmap_lazyloc/queries/photo_camera.h"
#include "colmap_lazyloc/queries/query_selection.h"
#include "colmap_lazyloc/scene/query_record.h"

namespace lazyloc {

// Makes the localization problem of a photo in memory: extracts features like the database's, chooses database images,
// matches and verifies. A photo that this does not localize can be loaded again, with all features compared, or with
// fallback features.
class PhotoLoader {
 public:
  // num_threads: for making the retrieval index, which happens here if a photo needs it. has_more_photos: photos that
  // the selection does not know may follow. The selection must outlive this. Throws InputError for files that cannot be
  // used, if no posed image has descriptors, and if photos cannot have such features.
  PhotoLoader(const DatabaseReader& database, const QuerySelection& selection, const PhotoOptions& options, int seed,
              int num_threads, bool has_more_photos);

  // Adds keypoints and times to the record. Throws Refusal if the photo cannot be used. Leaves out database images
  // whose features are damaged, and says so in the record. Throws InputError for a damaged file. Thread-safe with one
  // reader per thread; the result depends only on the input.
  LocalizationProblem Load(const PhotoQuery& photo, const Attempt& attempt, const FeatureReader& features,
                           IdleThreads* idle_threads, QueryRecord* record) const;
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
  const std::vector<std::string>& Warnings() const { return warnings_; }
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
  // Returns the index, of coarse features if features are extracted on demand.
  std::unique_ptr<RetrievalIndex> MakeIndex(const DatabaseReader& database, int num_threads) const;
  // Sets what extracts and matches features like those of the database.
  void ChooseMethods(FeatureType type, const FeatureReader& reader);
  // Throws Refusal if the file is not a readable image.
  PhotoFile ReadFile(const PhotoQuery& photo, const FeatureMethod& method, QueryRecord* record) const;
  // Returns the cameras that have the photo's size, of which one may have taken it, with their makes and models if the
  // photo's are known. If posed images are in the folder of the photos, their EXIF tells these.
  std::vector<DatabaseCamera> CamerasLike(const PhotoProperties& photo) const;
  std::string ReadExifCamera(uint32_t camera_id) const;
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
  Candidates ChooseCandidates(const PhotoQuery& photo, const Features& features, size_t num_retrieved,
                              IdleThreads* idle_threads) const;
  bool NeedsRetrieval(const PhotoQuery& photo) const;
  // Adds the candidates' pairs to the problem and returns their features, but those that are damaged.
  DatabaseFeatures AddPairs(const Candidates& candidates, const FeatureReader& features, IdleThreads* idle_threads,
                            LocalizationProblem* problem, QueryRecord* record) const;

  const QuerySelection& selection_;
  const PhotoOptions options_;
  const int seed_;
  const DefaultCamera default_camera_;
  std::vector<Candidate> candidates_;  // sorted by name
  FeatureMethods methods_;
  std::optional<ExtractedFeatures> extracted_;        // of candidates that are not stored; nullopt if all must be
  std::unique_ptr<const FallbackFeatures> fallback_;  // null without methods_.fallback
  std::unique_ptr<MatchesOutput> matches_output_;
  std::unique_ptr<RetrievalIndex> index_;
  FeatureStatistics statistics_;  // of the candidates
  PhotoScale database_scale_;     // medians over the candidates
  std::vector<std::string> warnings_;
  mutable LruCache<Features> features_;
  mutable LruCache<std::string> exif_cameras_;  // by the id of the camera
};

}  // namespace lazyloc
