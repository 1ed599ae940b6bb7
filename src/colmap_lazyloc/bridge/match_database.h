#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

// New COLMAP database, written by COLMAP. Keeps the ids of the caller, which must be unique. Throws std::exception if
// COLMAP cannot write.
class MatchDatabase {
 public:
  // path: a file that does not exist yet.
  explicit MatchDatabase(const std::filesystem::path& path);
  // False for all but SIFT in a build against COLMAP 3.
  static bool CanHold(FeatureType type);
  ~MatchDatabase();
  MatchDatabase(const MatchDatabase&) = delete;
  MatchDatabase& operator=(const MatchDatabase&) = delete;

  void AddCamera(const Camera& camera);
  void AddImage(uint32_t image_id, uint32_t camera_id, const std::string& name, const Features& features);
  // geometry: oriented from the database image to the query.
  void AddPair(uint32_t database_id, uint32_t query_id, const Matches& matches, const TwoViewGeometry& geometry);
  // Completes the file. Add nothing afterwards.
  void Close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lazyloc
