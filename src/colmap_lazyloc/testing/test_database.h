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

// COLMAP database for tests, as the given version of COLMAP writes it, without the tables that no test reads: in WAL
// mode, with pairs stored from the smaller to the larger image id and with placeholders for values that are not set.
// Throws std::runtime_error if SQLite fails.
class TestDatabase {
 public:
  enum class Schema { V3_6, V3_8, V3_10, V4_2 };

  // path: a file that does not exist yet.
  TestDatabase(const std::filesystem::path& path, Schema schema);
  ~TestDatabase();
  TestDatabase(const TestDatabase&) = delete;
  TestDatabase& operator=(const TestDatabase&) = delete;

  void AddCamera(const Camera& camera);
  void AddImage(uint32_t image_id, uint32_t camera_id, const std::string& name);
  // num_cols: 2, 4 or 6, depending on the version of COLMAP and the type of feature.
  void AddKeypoints(uint32_t image_id, const std::vector<Eigen::Vector2d>& keypoints, int num_cols = 6);
  void AddScaledKeypoints(uint32_t image_id, const std::vector<Keypoint>& keypoints);
  // type: COLMAP 4's FeatureExtractorType as a number; 0 is SIFT. Not stored in other schemas.
  void AddDescriptors(uint32_t image_id, const Descriptors& descriptors, int type = 0);
  // Add matches and geometry that are oriented from the database image to the query.
  void AddMatches(uint32_t query_id, uint32_t database_id, const Matches& matches);
  void AddTwoViewGeometry(uint32_t query_id, uint32_t database_id, const TwoViewGeometry& geometry);
  void Execute(const std::string& sql);
  // Merges the WAL into the file. A database can be read before it is closed, too.
  void Close();

 private:
  using Blob = std::vector<unsigned char>;  // empty: NULL
  using Value = std::variant<int64_t, std::string, Blob>;
  void Insert(const std::string& table, const std::vector<Value>& values);
  Blob MatrixBlob(const std::optional<Eigen::Matrix3d>& matrix) const;

  Schema schema_;
  sqlite3* connection_ = nullptr;
};

}  // namespace lazyloc
