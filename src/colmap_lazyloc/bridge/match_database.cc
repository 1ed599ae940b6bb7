#include "colmap_lazyloc/bridge/match_database.h"

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/database_writing.h"

namespace lazyloc {

struct MatchDatabase::Impl {
  explicit Impl(const std::filesystem::path& path)
      : database(OpenDatabase(path)), transaction(std::make_unique<colmap::DatabaseTransaction>(database.get())) {}

  std::shared_ptr<colmap::Database> database;
  std::unique_ptr<colmap::DatabaseTransaction> transaction;
};

MatchDatabase::MatchDatabase(const std::filesystem::path& path) : impl_(std::make_unique<Impl>(path)) {}
MatchDatabase::~MatchDatabase() = default;
bool MatchDatabase::CanHold(FeatureType type) { return CanWriteDescriptors(type); }

void MatchDatabase::AddCamera(const Camera& camera) {
  const colmap::Camera converted = ToColmap(camera);
  impl_->database->WriteCamera(converted, /*use_camera_id=*/true);
  WriteRigOf(converted, impl_->database.get());
}

void MatchDatabase::AddImage(uint32_t image_id, uint32_t camera_id, const std::string& name, const Features& features) {
  colmap::Image image;
  image.SetImageId(image_id);
  image.SetCameraId(camera_id);
  image.SetName(name);
  impl_->database->WriteImage(image, /*use_image_id=*/true);
  WriteFrameOf(image, impl_->database.get());
  colmap::FeatureKeypoints keypoints;
  keypoints.reserve(features.keypoints.size());
  for (const Keypoint& keypoint : features.keypoints) {
    keypoints.emplace_back(keypoint.x, keypoint.y, keypoint.a11, keypoint.a12, keypoint.a21, keypoint.a22);
  }
  impl_->database->WriteKeypoints(image_id, keypoints);
  WriteDescriptors(image_id, features, impl_->database.get());
}

void MatchDatabase::AddPair(uint32_t database_id, uint32_t query_id, const Matches& matches,
                            const TwoViewGeometry& geometry) {
  impl_->database->WriteMatches(database_id, query_id, ToColmap(matches));
  colmap::TwoViewGeometry converted;
  converted.config = static_cast<int>(geometry.config);
  converted.inlier_matches = ToColmap(geometry.inlier_matches);
  if (geometry.E) converted.E = *geometry.E;
  if (geometry.F) converted.F = *geometry.F;
  if (geometry.H) converted.H = *geometry.H;
  if (geometry.query_from_other) converted.cam2_from_cam1 = ToColmap(*geometry.query_from_other);
  impl_->database->WriteTwoViewGeometry(database_id, query_id, converted);
}

void MatchDatabase::Close() {
  impl_->transaction.reset();
  impl_->database->Close();
}

}  // namespace lazyloc
