#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

struct QueryRecord;

struct DatabaseImage {
  uint32_t image_id = 0;
  uint32_t camera_id = 0;
  std::string name;
};

// A row of the table images that cannot be used.
struct DamagedImage {
  std::string name;    // empty if it cannot be read
  std::string damage;  // as in DamagedRecordError
};

// An image that belongs to a frame of a rig (COLMAP 4.x).
struct DatabaseRigImage {
  uint32_t image_id = 0;
  uint32_t frame_id = 0;
  std::optional<Rigid3d> cam_from_rig;  // nullopt if the rig is not calibrated
};

// How many matches a pair has; `image_id` is the other image of the pair.
struct PairSize {
  uint32_t image_id = 0;
  int num_matches = 0;
};

// Reads a COLMAP database of any version from 3.6 to 4.2 without writing: the file, its folder, its WAL and journal are
// byte-identical afterwards, and the folder may be read-only. Finds columns by name. Also reads what a crashed or still
// open COLMAP has left in the WAL.
// Every function throws InputError, one line naming the file, for a damaged file, and if another program writes to the
// database meanwhile, because no lock prevents it; DamagedRecordError for one damaged record. Has one connection: use
// one reader per thread.
class DatabaseReader {
 public:
  explicit DatabaseReader(const std::filesystem::path& path);
  ~DatabaseReader();

  const std::filesystem::path& Path() const;

  // Returns all images, sorted by name, without damaged ones, which are appended to `damaged` unless it is null. Only
  // this table (a few dozen bytes a row) is ever read whole.
  std::vector<DatabaseImage> ReadImages(std::vector<DamagedImage>* damaged = nullptr) const;
  // Returns the images of all frames, ordered by frame; empty if the version has no rigs. Leaves out images whose place
  // in the rig is damaged, and appends the damage to `damages`.
  std::vector<DatabaseRigImage> ReadRigImages(std::vector<std::string>* damages) const;
  // Returns a camera with finite parameters as it is stored; the caller checks its model and parameters.
  Camera ReadCamera(uint32_t camera_id) const;
  // Return all keypoints of an image, xy in pixels; empty if the image has none. ReadKeypoints keeps those of the last
  // images in up to 32 MiB; the other function does not, because a query is read only once.
  std::vector<Eigen::Vector2d> ReadKeypoints(uint32_t image_id) const;
  std::vector<Eigen::Vector2d> ReadKeypointsOnce(uint32_t image_id) const;

  // Return those of other_ids (sorted) that an image has a pair with: one with at least one verified inlier, or at
  // least one raw match. They read no match. Their time grows with other_ids and the pairs of the image, not with the
  // database. A pair whose number is damaged has one match here, because reading the pair tells what is wrong.
  std::vector<PairSize> ReadInlierCounts(uint32_t image_id, const std::vector<uint32_t>& other_ids) const;
  std::vector<PairSize> ReadMatchCounts(uint32_t image_id, const std::vector<uint32_t>& other_ids) const;

  // Return a pair's data, oriented from the other image to the query whichever has the smaller id; no matches or
  // nullopt if nothing is stored. Matches are sorted; the caller checks their indices against the keypoints. E, F, H
  // and the relative pose are nullopt if they are placeholders of some version (NULL, zeros, identity).
  Matches ReadMatches(uint32_t query_id, uint32_t other_id) const;
  std::optional<TwoViewGeometry> ReadTwoViewGeometry(uint32_t query_id, uint32_t other_id) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// A database and its images, sorted by name, whose list takes time and memory to read.
struct DatabaseContent {
  const DatabaseReader& reader;
  const std::vector<DatabaseImage>& images;
  // Returns the keypoints of an image that has none in the database, but had some in the run; null if there are none.
  std::function<std::vector<Eigen::Vector2d>(const std::string&)> extracted_keypoints = nullptr;
  // True if a query was matched with these keypoints of the database images, and not with others, as of fallback
  // features; null if all were.
  std::function<bool(const QueryRecord&)> was_matched_with_them = nullptr;
};

}  // namespace lazyloc
