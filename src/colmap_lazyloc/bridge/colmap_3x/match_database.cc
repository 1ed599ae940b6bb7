#include "colmap_lazyloc/bridge/match_database.h"

#include <colmap/scene/database.h>

#include "colmap_lazyloc/bridge/colmap_3x/convert.h"

namespace lazyloc {

struct MatchDatabase::Impl {
  explicit Impl(const std::filesystem::path& path)
      : database(path.string()), transaction(std::make_unique<colmap::DatabaseTransaction>(&database)) {}

  colmap::Database database;
  std::unique_ptr<colmap::DatabaseTransaction> transaction;
};

MatchDatabase::MatchDatabase(const std::filesystem::path& path) : impl_(std::make_unique<Impl>(path)) {}
MatchDatabase::~MatchDatabase() = default;

void MatchDatabase::AddCamera(const Camera& camera) {
  impl_->database.WriteCamera(ToColmap(camera), /*use_camera_id=*/true);
}

void MatchDatabase::AddImage(uint32_t image_id, uint32_t camera_id, const std::string& name, const Features& features) {
  colmap::Image image;
  image.SetImageId(image_id);
  image.SetCameraId(camera_id);
  image.SetName(name);
  impl_->database.WriteImage(image, /*use_image_id=*/true);
  colmap::FeatureKeypoints keypoints;
  keypoints.reserve(features.keypoints.size());
  for (const Keypoint& keypoint : features.keypoints) {
    keypoints.emplace_back(keypoint.x, keypoint.y, keypoint.a11, keypoint.a12, keypoint.a21, keypoint.a22);
  }
  impl_->database.WriteKeypoints(image_id, keypoints);
  impl_->database.WriteDescriptors(image_id, features.descriptors);
}

void MatchDatabase::AddPair(uint32_t database_id, uint32_t query_id, const Matches& matches,
                            const TwoViewGeometry& geometry) {
  impl_->database.WriteMatches(database_id, query_id, ToColmap(matches));
  colmap::TwoViewGeometry converted;
  converted.config = static_cast<int>(geometry.config);
  converted.inlier_matches = ToColmap(geometry.inlier_matches);
  converted.E = geometry.E.value_or(Eigen::Matrix3d::Zero());
  converted.F = geometry.F.value_or(Eigen::Matrix3d::Zero());
  converted.H = geometry.H.value_or(Eigen::Matrix3d::Zero());
  if (geometry.query_from_database) {
    converted.cam2_from_cam1 = {geometry.query_from_database->rotation, geometry.query_from_database->translation};
  }
  impl_->database.WriteTwoViewGeometry(database_id, query_id, converted);
}

void MatchDatabase::Close() {
  impl_->transaction.reset();
  impl_->database.Close();
}

}  // namespace lazyloc
