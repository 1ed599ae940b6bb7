#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/formats/query_files.h"
#include "colmap_lazyloc/loading/database_cameras.h"
#include "colmap_lazyloc/loading/matches_output.h"
#include "colmap_lazyloc/matching/feature_statistics.h"
#include "colmap_lazyloc/matching/pair_matching.h"
#include "colmap_lazyloc/matching/retrieval_index.h"
#include "colmap_lazyloc/queries/photo_camera.h"
#include "colmap_lazyloc/queries/query_record.h"
#include "colmap_lazyloc/queries/query_selection.h"

namespace lazyloc {

struct PhotoOptions {
  std::string image_path;  // folder of the photos; empty: no query is a photo
  std::string camera_model = "SIMPLE_RADIAL";
  std::string camera_params;  // of all photos without a known camera; numbers separated by commas
  std::string retrieval_index_path;
  std::string matches_output_path;
  SiftExtractionOptions extraction;
  AlikedOptions aliked;
  double cache_gb = 1;  // memory for the features of database images

  bool Check(std::string* error) const;
  // Returns false if files for photos are named although image_path is empty.
  bool CheckImagePath(std::string* error) const;
};

// Makes the localization problem of a photo in memory: extracts features, chooses database images, matches and
// verifies.
class PhotoLoader {
 public:
  // num_retrieved: database images per photo, if they are retrieved. num_threads: for making the retrieval index, which
  // happens here if a photo needs it. has_more_photos: photos that the selection does not know may follow. The
  // selection must outlive this. Throws InputError for files that cannot be used, if no posed image has descriptors,
  // and if photos cannot have such features.
  PhotoLoader(const DatabaseReader& database, const QuerySelection& selection, const PhotoOptions& options,
              int num_retrieved, int seed, int num_threads, bool has_more_photos);

  // Adds keypoints and times to the record. Returns nullopt, with status and reason in the record, if the photo cannot
  // be used. Leaves out database images whose features are damaged, and says so in the record. Throws InputError for a
  // damaged file. Thread-safe with one reader per thread; the result depends only on the input.
  std::optional<LocalizationProblem> Load(const PhotoQuery& photo, const FeatureReader& features,
                                          IdleThreads* idle_threads, QueryRecord* record) const;
  // Returns one line for each problem that does not end the run.
  const std::vector<std::string>& Warnings() const { return warnings_; }
  // Returns how the features of photos are extracted, for a photo like the database images.
  std::string DescribeExtraction() const;
  // Publishes the database at matches_output_path, if there is one.
  void PublishMatches() const;

 private:
  struct Candidate {
    const ModelImage* image = nullptr;
    uint32_t image_id = 0;  // in the database
  };
  using Candidates = std::vector<const Candidate*>;
  using DatabaseFeatures = std::vector<std::shared_ptr<const Features>>;

  // Sets what extracts and matches features of the database's type. Throws InputError if there is nothing.
  void PrepareFor(FeatureType type, const std::string& database_path);
  Features Extract(const PhotoFile& file, const Camera& camera, IdleThreads* idle_threads) const;
  // Sets the statistics of the candidates' features.
  void MeasureCandidates(const std::map<uint32_t, size_t>& num_descriptors, const FeatureReader& reader);
  // Returns the photo's own intrinsics if it has any, or else chooses some.
  PhotoCamera CameraOf(const PhotoQuery& photo, const PhotoProperties& properties) const;
  // Returns the candidates that the pairs file lists, or all.
  Candidates AllowedCandidates(const PhotoQuery& photo) const;
  Candidates ChooseCandidates(const PhotoQuery& photo, const Features& features, IdleThreads* idle_threads) const;
  bool NeedsRetrieval(const PhotoQuery& photo) const;
  // Adds pairs with the candidates to the problem, without matches; returns their features. Leaves out damaged ones.
  DatabaseFeatures LoadPairs(const Candidates& candidates, const FeatureReader& reader, LocalizationProblem* problem,
                             std::vector<std::string>* damages) const;

  const QuerySelection& selection_;
  const PhotoOptions options_;
  const size_t num_retrieved_;
  const int seed_;
  const DefaultCamera default_camera_;
  const DatabaseCameras database_cameras_;
  std::vector<Candidate> candidates_;     // posed images with descriptors, sorted by name
  std::unique_ptr<const Aliked> aliked_;  // null for SIFT
  std::unique_ptr<MatchesOutput> matches_output_;
  std::unique_ptr<RetrievalIndex> index_;
  FeatureStatistics statistics_;  // of the candidates
  PhotoScale database_scale_;     // medians over the candidates
  std::vector<std::string> warnings_;
  mutable LruCache<Features> features_;
};

}  // namespace lazyloc
