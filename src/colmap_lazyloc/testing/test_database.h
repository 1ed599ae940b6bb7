#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

struct sqlite3;

namespace lazyloc {

// Creates a COLMAP database for tests, as the given version of COLMAP would (but for tables that are of no interest to
// us): WAL mode, a pair stored from its smaller image id to the larger, placeholders for what is not set.
// Throws std::runtime_error.
class TestDatabase {
 public:
  enum class Schema { V3_6, V3_8, V3_10, V4_2 };

  // The file must not exist yet.
  TestDatabase(const std::filesystem::path& path, Schema schema);
  ~TestDatabase();
  TestDatabase(const TestDatabase&) = delete;
  TestDatabase& operator=(const TestDatabase&) = delete;

  void AddCamera(const Camera& camera);
  void AddImage(uint32_t image_id, uint32_t camera_id, const std::string& name);
  // num_cols: 2, 4 or 6, by version of COLMAP and kind of feature.
  void AddKeypoints(uint32_t image_id, const std::vector<Eigen::Vector2d>& keypoints, int num_cols = 6);
  // type: COLMAP 4.x's, where 0 is SIFT.
  void AddDescriptors(uint32_t image_id, const Descriptors& descriptors, int type = 0);
  // Matches and geometry are oriented as everywhere: from the database image to the query.
  void AddMatches(uint32_t query_id, uint32_t database_id, const Matches& matches);
  void AddTwoViewGeometry(uint32_t query_id, uint32_t database_id, const TwoViewGeometry& geometry);
  void Execute(const std::string& sql);
  // Merges the WAL into the file. What is not closed can be read already.
  void Close();

 private:
  using Blob = std::vector<unsigned char>;  // empty is NULL
  using Value = std::variant<int64_t, std::string, Blob>;
  void Insert(const std::string& table, const std::vector<Value>& values);
  Blob MatrixBlob(const std::optional<Eigen::Matrix3d>& matrix) const;

  Schema schema_;
  sqlite3* connection_ = nullptr;
};

}  // namespace lazyloc
