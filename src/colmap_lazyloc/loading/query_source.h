#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/formats/query_prior_files.h"
#include "colmap_lazyloc/loading/attempt.h"
#include "colmap_lazyloc/loading/database_neighbours.h"
#include "colmap_lazyloc/loading/depth_maps.h"
#include "colmap_lazyloc/loading/loaded_group.h"
#include "colmap_lazyloc/loading/pair_loader.h"
#include "colmap_lazyloc/loading/photo_loader.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/queries/query_selection.h"

namespace lazyloc {

// Everything that says where queries come from and what they are localized against.
struct SourceOptions {
  std::string database_path, input_path;
  int num_retrieved = 20;  // database images per query
  // Which of the queries whose intrinsics nobody has stated share their camera: all of the same size, those of one
  // camera in the database (neither is true), or none.
  bool single_camera = false, single_camera_per_image = false;
  QuerySelectionOptions selection;
  PhotoOptions photos;
  QueryPriorOptions priors;
  DepthMapOptions depth;
  // False if the errors of database poses are stated, so that pairs of database images need not tell them.
  bool reads_database_pairs = true;

  bool Check(std::string* error) const;
};

// A query: the name of one that the selection knows, a photo, or features and matches.
using QueryInput = std::variant<std::string, PhotoQuery, LocalizationProblem>;

// Queries that are localized together.
struct GroupInput {
  struct Image {
    QueryInput query;
    Rigid3d cam_from_rig;
    QueryPrior prior = {};
  };
  struct Frame {
    std::string name;
    std::vector<Image> images;
  };
  std::vector<Frame> frames;
  bool has_rig_scale = true;  // false if the unit of cam_from_rig is unknown
};

// Returns the problem of a query, and adds to its record. Throws Refusal if the query cannot be used.
using LoadQueryFunction = std::function<LocalizationProblem(const GroupInput::Image&, QueryRecord*)>;
// Loads the queries of a group, but no pairs among them.
LoadedGroup LoadEach(const GroupInput& input, const LoadQueryFunction& load_query);

// The queries of a run, in groups that are localized together. Whether a query is an image of the database or a photo,
// it is loaded here.
class QuerySource {
 public:
  // The readers of one thread. idle_threads: help with the pairs of photos.
  struct Session {
    Session(const QuerySource& source, IdleThreads* threads);

    DatabaseReader database;
    std::unique_ptr<FeatureReader> features;  // null until a query is a photo
    IdleThreads* idle_threads;
  };

  // model: the one at input_path. seed, num_threads: for photos, whose matches are verified and whose retrieval index
  // is made here (num_threads: -1 for the number of cores). Throws InputError for files and options that cannot be
  // used.
  QuerySource(const SourceOptions& options, Model model, int seed, int num_threads);

  const QuerySelection& Selection() const { return selection_; }
  size_t NumGroups() const { return selection_.Groups().Size(); }
  size_t NumQueries() const { return selection_.NumQueries(); }
  // Returns the posed images that queries are localized against.
  const Model& DatabaseModel() const { return selection_.DatabaseModel(); }
  const DatabaseReader& Database() const { return database_; }
  // Returns one line for each problem that does not end the run.
  std::vector<std::string> Warnings() const;
  // Returns one line on how the features of photos are extracted; empty without photos.
  std::string DescribeExtraction() const { return photo_loader_ ? photo_loader_->DescribeExtraction() : ""; }
  // Returns one group of the selection.
  GroupInput Group(size_t group) const;
  // Returns the first attempt at any group.
  Attempt FirstAttempt() const;
  // True if the position of a photo in the group says which database images are near it (Attempt::only_near).
  bool HasNearImages(const GroupInput& input) const;
  // True if comparing all features may find more matches of a photo than the first attempt, which has loaded `first`.
  bool HasFurtherFeatures(const LoadedGroup& first) const;
  // True if a group can be loaded with fallback features: all of its queries are photos.
  bool HasFallback(const GroupInput& input) const;
  // Loads a group. first: what the first attempt has loaded, which fallback features start from; null for that attempt
  // itself. Thread-safe with one session per thread. Throws InputError for a damaged file; damaged records are left
  // out, and queries that cannot be used are refused. The first photo may take long, because it makes the retrieval
  // index.
  LoadedGroup Load(const GroupInput& input, const Attempt& attempt, const LoadedGroup* first, Session* session) const;
  // Adds what the database images of the pairs tell by themselves, which Load does too: pairs with each other, and the
  // depths of their keypoints.
  void AddDatabasePairsAndDepths(Session* session, LoadedGroup* loaded) const;
  // Returns the depth maps of database images; null without a folder of maps.
  const DepthMaps* Depths() const { return depth_maps_ ? &*depth_maps_ : nullptr; }
  // Returns the keypoints of a database image whose features were extracted on demand; empty for all others.
  std::vector<Eigen::Vector2d> ExtractedKeypoints(const std::string& image_name) const {
    return photo_loader_ ? photo_loader_->ExtractedKeypoints(image_name) : std::vector<Eigen::Vector2d>();
  }
  // True if a query was matched with the keypoints of database images that the database has, or else the first attempt.
  bool HasStoredKeypoints(const QueryRecord& record) const {
    return !record.matcher || Photos().HasStoredKeypoints(record);
  }
  // Publishes the photos' features and matches, if they are kept.
  void PublishMatches() const;

 private:
  // Returns the loader of photos, which the first call makes.
  const PhotoLoader& Photos() const;
  // Gives named queries the priors in files that they lack.
  GroupInput WithPriors(GroupInput input) const;
  LocalizationProblem LoadQuery(const GroupInput::Image& image, const Attempt& attempt, Session* session,
                                QueryRecord* record) const;
  // Returns where a photo was taken, as far as it is known before it is localized.
  std::optional<PositionPrior> RoughPosition(const std::string& photo_name, const QueryPrior& prior) const;
  // Returns a group that was loaded with what fallback features see.
  LoadedGroup LoadFallback(const GroupInput& input, const LoadedGroup& first, Session* session) const;
  // Returns null if the query is not a photo.
  const PhotoQuery* FindPhoto(const QueryInput& query) const;

  const SourceOptions options_;
  const int seed_;
  const int num_threads_;
  DatabaseReader database_;
  QuerySelection selection_;
  PairLoader pair_loader_;
  std::map<std::string, QueryPrior> priors_;           // by query; those in files
  std::map<std::string, QueryPrior> rough_positions_;  // by photo; those that only choose database images
  std::optional<DepthMaps> depth_maps_;                // nullopt without a folder of maps
  DatabaseNeighbours neighbours_;
  mutable std::once_flag photo_loader_is_made_;
  mutable std::unique_ptr<PhotoLoader> photo_loader_;  // null until a query is a photo
};

}  // namespace lazyloc
