#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/database/database_reader.h"
#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/formats/query_files.h"
#include "colmap_lazyloc/queries/photo_camera.h"
#include "colmap_lazyloc/queries/query_groups.h"
#include "colmap_lazyloc/scene/intrinsics_source.h"
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
};

// A query whose features are not in the database.
struct PhotoQuery {
  std::string name;
  std::string path;                                        // below the folder of the photos; empty: the name
  std::optional<PhotoFile> file;                           // nullopt if the photo is to be read from `path`
  std::optional<Camera> camera;                            // nullopt if neither query list, model nor database has one
  IntrinsicsSource source = IntrinsicsSource::QUERY_LIST;  // of `camera`
  std::optional<std::vector<uint32_t>> paired_ids;         // as QuerySelection::ListedPairs
  size_t group = 0;
  std::string damage;  // what makes its records unusable, as in DamagedRecordError; empty if nothing does
};

// Returns a pair with a database image: name, camera, pose and frame, but no keypoints and matches.
ImagePair MakeDatabasePair(const ModelImage& database_image, const Model& model, const FramePlaces& frames);

// Decides once, before any query is loaded, which images are queries and which are database images, how the queries are
// grouped, and which pairs a pairs file allows. Its memory grows with the images of the database, but a query adds only
// a few bytes: what the database has of it is read when it is loaded.
class QuerySelection {
 public:
  // image_path: folder of photos, which queries without keypoints in the database are; empty: none is a photo. Throws
  // InputError for files that cannot be used or a query that is not in the database.
  QuerySelection(const DatabaseReader& database, Model model, const QuerySelectionOptions& options,
                 const std::string& image_path);

  // Returns the queries in groups, each of which is localized together.
  const QueryGroups& Groups() const { return groups_; }
  size_t NumQueries() const { return num_queries_; }
  // Returns the photos among the queries, by name.
  const std::map<std::string, PhotoQuery>& Photos() const { return photos_; }
  // Returns the index of the group that a query belongs to; nullopt if no query has this name.
  std::optional<size_t> FindGroup(const std::string& query_name) const;
  // Returns the id of a query whose keypoints are in the database; nullopt if there is none of this name.
  std::optional<uint32_t> FindStoredQuery(const std::string& name) const;
  // Reads a query that is not a photo. Throws DamagedRecordError if its records cannot be used.
  StoredQuery ReadStoredQuery(const std::string& name, const DatabaseReader& database) const;
  // Returns the posed images without the queries; with leave_one_out all posed images.
  const Model& DatabaseModel() const { return model_; }
  // Returns the cameras of posed images that have the query's size, of which one may have taken it, with makes, models
  // and focal lengths in EXIF if the query has one of these. If posed images are in the folder of the photos, their
  // EXIF shows these.
  std::vector<DatabaseCamera> CamerasLike(const PhotoProperties& query) const;
  // Returns the rig frames of the posed images that share their frame with another one.
  const FramePlaces& DatabaseFrames() const { return frame_of_database_image_; }
  // Returns the images of the database, sorted by name, without those whose row is damaged.
  const std::vector<DatabaseImage>& DatabaseImages() const { return database_images_; }
  // Returns null if the database file does not hold an image of this name, or its row is damaged.
  const DatabaseImage* FindInDatabase(const std::string& name) const { return FindByName(database_images_, name); }
  // Returns the ids of the posed images in the database, sorted.
  const std::vector<uint32_t>& PosedImageIds() const { return posed_ids_; }
  // Returns the posed image with an id of the database; null if the image has no pose or is in the query's own group.
  // query_name: also one that is not known here.
  const ModelImage* FindPosedImage(uint32_t image_id, const std::string& query_name) const;
  // Returns the ids of the other images that the pairs file lists for a query, sorted; nullopt without a pairs file.
  std::optional<std::vector<uint32_t>> ListedPairs(const StoredQuery& query) const;
  // Returns true if queries are posed images themselves, which take no part in their own localization.
  bool HasPosedQueries() const { return options_.leave_one_out; }
  // Does the same as MakeDatabasePair for one of the posed images.
  ImagePair MakePair(const ModelImage& database_image) const {
    return MakeDatabasePair(database_image, model_, frame_of_database_image_);
  }
  // Returns one line for each problem that does not end the run.
  const std::vector<std::string>& Warnings() const { return warnings_; }

 private:
  // What is known of a database image that may be a query.
  struct ImageRole {
    bool is_query = false;
    IntrinsicsSource source = IntrinsicsSource::DATABASE;
    uint32_t camera = 0;  // index in listed_cameras_, or id in the model
    uint32_t group = 0;
  };

  const ImageRole& RoleOf(const DatabaseImage& image) const { return roles_[&image - database_images_.data()]; }
  ImageRole& RoleOf(const DatabaseImage& image) { return roles_[&image - database_images_.data()]; }
  void ReadImages(const DatabaseReader& database);
  // Returns the focal lengths in the EXIF of the posed images, by the model's camera.
  std::map<uint32_t, double> ReadExifFocalLengths(const DatabaseReader& database) const;
  // Returns what the file of a posed image shows about its camera; nothing if there is no file.
  PhotoProperties ReadPropertiesOfCamera(uint32_t camera_id) const;
  // Returns the damage of the row of an image; empty if the row is not damaged.
  std::string DamageOf(const std::string& name) const;
  // Returns the names of the queries in their order, in the memory of this class.
  std::vector<std::string_view> AddQueries(const DatabaseReader& database);
  // Return the name in the memory of this class; an empty one if the query was added before.
  std::string_view AddStoredQuery(QueryListEntry entry, const ModelImage* posed, const DatabaseReader& database);
  std::string_view AddPhoto(const QueryListEntry& entry, const ModelImage* posed, const DatabaseReader& database);
  bool IsPhoto(const std::string& name, const DatabaseReader& database) const;
  void GroupAll(const std::vector<std::string_view>& query_names, const DatabaseReader& database);
  void ReadPairsFile();
  // Adds an image of the database to a query's pairs. Does nothing if there is no such query or image.
  void AddListedPair(const std::string& query_name, const std::string& other_name);

  const QuerySelectionOptions options_;
  const std::string image_path_;
  const bool has_photos_;
  Model model_;
  std::vector<DatabaseImage> database_images_;                    // sorted by name
  std::vector<ImageRole> roles_;                                  // of database_images_
  std::vector<Camera> listed_cameras_;                            // of the query list
  std::unordered_map<std::string, std::string> damage_of_image_;  // by name; images whose row is damaged
  std::string damage_of_unknown_image_;                           // of a row without a readable name; may be empty
  std::optional<CamerasBySize> database_cameras_;                 // of the posed images
  mutable LruCache<PhotoProperties> camera_properties_;           // of an image of each camera, by the id of the camera
  std::vector<uint32_t> posed_ids_;
  std::unordered_map<uint32_t, const ModelImage*> posed_of_database_id_;
  FramePlaces frame_of_database_image_;                   // by name; rig frames of several images only
  std::map<std::string, size_t> group_of_damaged_query_;  // by name; queries whose row is damaged
  std::map<std::string, PhotoQuery> photos_;
  size_t num_queries_ = 0;
  QueryGroups groups_;
  std::vector<std::pair<uint32_t, uint32_t>> listed_pairs_;  // ids of stored queries and the other images, sorted
  std::vector<std::string> warnings_;
};

}  // namespace lazyloc
