#pragma once

#include <cstdint>
#include <filesystem>
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

struct DatabaseImage {
  uint32_t image_id = 0;
  uint32_t camera_id = 0;
  std::string name;
};

// An image of a frame of a rig (COLMAP 4.x).
struct DatabaseRigImage {
  uint32_t image_id = 0;
  uint32_t frame_id = 0;
  std::optional<Rigid3d> cam_from_rig;  // none where the rig is not calibrated
};

// How many matches a pair has; `image_id` is the other image of the pair.
struct PairSize {
  uint32_t image_id = 0;
  int num_matches = 0;
};

// Strictly read-only reader of a COLMAP database of any version from 3.6 to 4.2: the file, its folder, its
// WAL and journal are byte-identical afterwards, in read-only folders too. Columns are found by name. What a crashed or
// still open COLMAP has left in the WAL is read as well.
// Every function throws InputError, one line naming the file, for what is missing, foreign or damaged, and if
// another program writes to the database meanwhile (nothing is locked against it).
// One connection: use one reader per thread.
class DatabaseReader {
 public:
  explicit DatabaseReader(const std::filesystem::path& path);
  ~DatabaseReader();
  DatabaseReader(DatabaseReader&&) noexcept;
  DatabaseReader& operator=(DatabaseReader&&) noexcept;

  const std::filesystem::path& Path() const;

  // All images, sorted by name (a few dozen bytes each; all that is ever read whole).
  std::vector<DatabaseImage> ReadImages() const;
  // The images that frames hold, by frame; none for versions that know no rigs.
  std::vector<DatabaseRigImage> ReadRigImages() const;
  // Camera parameters are given as stored; the caller judges the model.
  Camera ReadCamera(uint32_t camera_id) const;
  // xy in pixels of all keypoints of an image, in order; empty where the image has none. Those of the images last read
  // are kept, in up to 16 MiB.
  std::vector<Eigen::Vector2d> ReadKeypoints(uint32_t image_id) const;

  // The other images of all pairs of an image with at least one verified inlier, or at least one raw match;
  // sorted by image_id. No match is read. Pairs with an image that was deleted from the database are left out.
  std::vector<PairSize> ReadInlierCounts(uint32_t image_id) const;
  std::vector<PairSize> ReadMatchCounts(uint32_t image_id) const;

  // The pair's data, oriented as asked, whichever image has the smaller id. Matches are sorted; their indices are
  // given as stored, the caller checks them against the keypoints. Nothing stored: no matches, no geometry.
  // E, F, H and the relative pose are none where they are placeholders of some version (NULL, zeros, identity).
  Matches ReadMatches(uint32_t query_id, uint32_t database_id) const;
  std::optional<TwoViewGeometry> ReadTwoViewGeometry(uint32_t query_id, uint32_t database_id) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lazyloc
