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

// A new database, written by COLMAP itself. Ids are taken as given, each may come once. Throws std::exception where
// COLMAP cannot write.
class MatchDatabase {
 public:
  // path: must not exist yet.
  explicit MatchDatabase(const std::filesystem::path& path);
  ~MatchDatabase();
  MatchDatabase(const MatchDatabase&) = delete;
  MatchDatabase& operator=(const MatchDatabase&) = delete;

  void AddCamera(const Camera& camera);
  void AddImage(uint32_t image_id, uint32_t camera_id, const std::string& name, const Features& features);
  // geometry: from the database image to the query, as everywhere.
  void AddPair(uint32_t database_id, uint32_t query_id, const Matches& matches, const TwoViewGeometry& geometry);
  // Nothing is added after this; the file is complete.
  void Close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lazyloc
