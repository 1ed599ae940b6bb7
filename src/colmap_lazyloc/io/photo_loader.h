#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/io/problem_loader.h"
#include "colmap_lazyloc/io/query_files.h"
#include "colmap_lazyloc/matching/feature_cache.h"
#include "colmap_lazyloc/matching/options.h"
#include "colmap_lazyloc/matching/pair_matching.h"
#include "colmap_lazyloc/matching/retrieval_index.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

struct PhotoLoaderOptions {
  std::string image_path;  // folder of the photos
  std::string camera_model = "SIMPLE_RADIAL";
  std::string camera_params;  // of all photos whose camera is not known otherwise; numbers with commas between
  std::string retrieval_index_path;
  std::string query_prior_path;
  PhotoMatchingOptions matching;
  RetrievalOptions retrieval;

  bool Check(std::string* error) const;
};

// Why there is no problem to be solved.
struct PhotoFailure {
  QueryStatus status;
  std::string reason;
};

// A photo's problem, with the features that its matches are of.
struct LoadedPhoto {
  LocalizationProblem problem;
  std::shared_ptr<const Features> features;
  std::vector<std::shared_ptr<const Features>> database_features;  // one per pair
};

// Makes the localization problem of a photo: features, candidates, matches and their verification, all in memory.
class PhotoLoader {
 public:
  // database_model: the posed images; it must outlive this. Opens or makes the retrieval index where one is needed for
  // the photos. Throws InputError for files that cannot be used, and where no posed image has descriptors.
  PhotoLoader(const DatabaseReader& database, const Model& database_model,
              const std::map<std::string, PhotoQuery>& photos, int num_retrieved,
              const PairMatchingOptions& pair_options, const PhotoLoaderOptions& options);

  // Throws PhotoFailure, or InputError for damaged data. Thread-safe with a reader per thread; the result depends on
  // the input alone. Adds the stages to `seconds`.
  LoadedPhoto Load(const PhotoQuery& photo, const FeatureReader& features, IdleThreads* idle_threads,
                   StageTimer::Seconds* seconds) const;

 private:
  struct DatabaseView {
    const ModelImage* image = nullptr;
    const Camera* camera = nullptr;
    uint32_t image_id = 0;  // in the database
  };

  Camera CameraOf(const PhotoQuery& photo, const Photo& file) const;
  // Of the posed images with descriptors: those that the pairs file lists, or that the photo's prior allows.
  std::vector<const DatabaseView*> AllowedViews(const PhotoQuery& photo) const;
  std::vector<const DatabaseView*> ChooseViews(const PhotoQuery& photo, const Descriptors& descriptors,
                                               IdleThreads* idle_threads) const;
  bool NeedsRetrieval(const PhotoQuery& photo) const;

  PhotoLoaderOptions options_;
  PairMatchingOptions pair_options_;
  size_t num_retrieved_ = 0;
  int camera_model_id_ = 0;
  std::vector<double> camera_params_;
  std::vector<DatabaseView> views_;  // sorted by name
  std::map<std::string, QueryPrior> priors_;
  std::unique_ptr<RetrievalIndex> index_;
  mutable FeatureCache cache_;
};

}  // namespace lazyloc
