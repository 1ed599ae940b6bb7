#include "colmap_lazyloc/pipeline/localize_lone.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

// Makes a query whose camera is too long by 3 %, beside its right camera as alternative. All pairs are
// uncalibrated.
SyntheticScene MakeSceneWithAlternative() {
  SyntheticSceneOptions options;
  options.pixel_noise_px = 0.5;
  SyntheticScene scene = MakeSyntheticScene(options);
  LocalizationProblem& problem = scene.problem;
  problem.alternative_camera = CandidateCamera{problem.query_camera, IntrinsicsOrigin::GIVEN};
  problem.query_camera = WithFocalFactor(problem.query_camera, 1.03);
  problem.intrinsics_origin = IntrinsicsOrigin::EXIF;
  for (ImagePair& pair : problem.pairs) {
    pair.geometry->config = TwoViewConfig::UNCALIBRATED;
    pair.geometry->query_from_other.reset();
  }
  return scene;
}

TEST(LocalizeLone, AlternativeCameraReplacesAContradictedOne) {
  const SyntheticScene scene = MakeSceneWithAlternative();
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  ASSERT_EQ(result.status, QueryStatus::LOCALIZED) << result.reason;
  EXPECT_EQ(result.query_camera.params, scene.problem.alternative_camera->camera.params);
  EXPECT_LE(PositionError(result.cam_from_world, scene.query_cam_from_world), 2e-3 * scene.median_depth);
}

// Stores what COLMAP would with the wrong camera: matrices with which all matches agree, but for that camera only.
TEST(LocalizeLone, EssentialMatricesOfAnotherCameraAreForgotten) {
  SyntheticScene scene = MakeSceneWithAlternative();
  const LocalizationResult expected = LocalizeQuery(scene.problem, {});
  for (ImagePair& pair : scene.problem.pairs) {
    const Rigid3d query_from_other = scene.query_cam_from_world * Inverse(pair.database_cam_from_world);
    const Eigen::Vector3d t = query_from_other.translation.normalized();
    Eigen::Matrix3d cross;
    cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
    const Eigen::Vector3d stretch(1.03, 1.03, 1);  // from directions of the wrong camera to those of the right one
    pair.geometry->E = stretch.asDiagonal() * cross * query_from_other.rotation.toRotationMatrix();
  }
  const LocalizationResult result = LocalizeQuery(scene.problem, {});
  EXPECT_EQ(result.status, expected.status);
  EXPECT_EQ(result.query_camera.params, expected.query_camera.params);
  EXPECT_EQ(result.cam_from_world.translation, expected.cam_from_world.translation);
  EXPECT_EQ(result.covariance, expected.covariance);
  for (size_t i = 0; i < expected.pairs.size(); ++i) {
    EXPECT_EQ(result.pairs[i].num_inliers, expected.pairs[i].num_inliers) << i;
  }
}

}  // namespace
}  // namespace lazyloc
