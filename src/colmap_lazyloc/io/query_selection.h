#pragma once

#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/io/intrinsics_source.h"
#include "colmap_lazyloc/io/query_files.h"
#include "colmap_lazyloc/io/query_groups.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

struct QuerySelectionOptions {
  std::string query_list_path;    // empty: all images without a pose (with leave_one_out: with a pose)
  std::string pairs_path;         // empty: the pairs that the database has matches for
  bool leave_one_out = false;     // queries are posed images; each group is localized against all others
  bool has_more_queries = false;  // queries that no file names may follow, so that there may be none
  QueryGroupsOptions groups;
};

// A query whose keypoints are in the database.
struct StoredQuery {
  DatabaseImage image;
  Camera camera;
  IntrinsicsOrigin intrinsics_origin = IntrinsicsOrigin::GIVEN;  // of `camera`
  IntrinsicsSource source = IntrinsicsSource::QUERY_LIST;        // of `camera`
  Camera stored_camera;  // as in the database, whose two-view geometries were estimated with it
  size_t group = 0;
  std::string damage;  // what makes its records unusable, as in DamagedRecordError; empty if nothing does
};

// A query whose features are not in the database.
struct PhotoQuery {
  std::string name;
  std::string path;                                        // below the folder of the photos; empty: the name
  std::optional<PhotoFile> file;                           // nullopt if the photo is to be read from `path`
  std::optional<Camera> camera;                            // nullopt if neither query list, model nor database has one
  IntrinsicsSource source = IntrinsicsSource::QUERY_LIST;  // of `camera`
  std::optional<std::vector<std::string>> pair_names;      // the other images in the pairs file, if there is a file
  size_t group = 0;
  std::string damage;  // as in StoredQuery
};

// Returns a pair with a database image: name, camera, pose and frame, but no keypoints and matches.
ImagePair MakeDatabasePair(const ModelImage& database_image, const Model& model, const FramePlaces& frames);

// Decides once, before any query is loaded, which images are queries and which are database images, how the queries are
// grouped, and which pairs a pairs file allows. Its memory grows only with the names and poses of the images.
class QuerySelection {
 public:
  // has_photos: queries without keypoints in the database are photos. Throws InputError for files that cannot be used
  // or a query that is not in the database.
  QuerySelection(const DatabaseReader& database, Model model, const QuerySelectionOptions& options, bool has_photos);

  // Returns the queries in groups, each of which is localized together.
  const std::vector<QueryFrames>& Groups() const { return groups_.groups; }
  bool HasRigScale() const { return groups_.has_rig_scale; }
  size_t NumQueries() const { return stored_queries_.size() + photos_.size(); }
  // Returns the photos among the queries, by name.
  const std::map<std::string, PhotoQuery>& Photos() const { return photos_; }
  // Returns the index of the group that a query belongs to; nullopt if no query has this name.
  std::optional<size_t> FindGroup(const std::string& query_name) const;
  // Returns null if the query is a photo.
  const StoredQuery* FindStoredQuery(const std::string& name) const;
  // Returns the posed images without the queries; with leave_one_out all posed images.
  const Model& DatabaseModel() const { return model_; }
  // Returns the rig frames of the posed images that share their frame with another one.
  const FramePlaces& DatabaseFrames() const { return frame_of_database_image_; }
  // Returns null if the database file does not hold an image of this name, or its row is damaged.
  const DatabaseImage* FindInDatabase(const std::string& name) const;
  // Returns the posed image with an id of the database; null if the image has no pose or is in the query's own group.
  const ModelImage* FindPosedImage(uint32_t image_id, const StoredQuery& query) const;
  // Does the same for any query, also for one whose name is not known here.
  const ModelImage* FindPosedImage(uint32_t image_id, const std::string& query_name) const;
  // Returns true if queries are posed images themselves, which take no part in their own localization.
  bool HasPosedQueries() const { return options_.leave_one_out; }
  // Returns the other images that the pairs file lists for a query; null without a pairs file.
  const std::vector<std::string>* ListedPairs(const std::string& query_name) const;
  // Does the same as MakeDatabasePair for one of the posed images.
  ImagePair MakePair(const ModelImage& database_image) const {
    return MakeDatabasePair(database_image, model_, frame_of_database_image_);
  }
  // Returns one line for each problem that does not end the run.
  const std::vector<std::string>& Warnings() const { return warnings_; }

 private:
  void ReadImages(const DatabaseReader& database);
  // Returns the damage of the row of an image; empty if the row is not damaged.
  std::string DamageOf(const std::string& name) const;
  std::vector<std::string> AddQueries(const DatabaseReader& database);
  void AddStoredQuery(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database);
  // Throws DamagedRecordError if the camera in the database cannot be read.
  void ChooseCamera(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database,
                    StoredQuery* query) const;
  void AddPhoto(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database);
  bool IsPhoto(const std::string& name, const DatabaseReader& database) const;
  bool IsQuery(const std::string& name) const { return stored_queries_.count(name) > 0 || photos_.count(name) > 0; }
  void GroupAll(const std::vector<std::string>& query_names, const DatabaseReader& database);
  void ReadPairsFile(const std::vector<std::string>& query_names);

  const QuerySelectionOptions options_;
  const bool has_photos_;
  Model model_;
  std::unordered_map<std::string, DatabaseImage> database_images_;  // by name
  std::unordered_map<std::string, std::string> damage_of_image_;    // by name; images whose row is damaged
  std::string damage_of_unknown_image_;                             // of a row without a readable name; may be empty
  std::unordered_map<uint32_t, const ModelImage*> posed_of_database_id_;
  FramePlaces frame_of_database_image_;  // by name; rig frames of several images only
  std::unordered_map<std::string, StoredQuery> stored_queries_;
  std::map<std::string, PhotoQuery> photos_;
  QueryGroups groups_;
  std::map<std::string, std::vector<std::string>> listed_pairs_;  // by query
  std::vector<std::string> warnings_;
};

}  // namespace lazyloc
