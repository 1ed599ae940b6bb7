#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

void Disturb(SyntheticTracks* scene, double rotation_deg, double translation, double point) {
  Random random(17);
  for (View& view : scene->views) {
    if (view.is_database) continue;
    view.cam_from_world.rotation = Disturbed(view.cam_from_world.rotation, rotation_deg, &random);
    view.cam_from_world.translation += translation * RandomVector(&random);
  }
  for (Track& track : scene->tracks) track.point_in_world += point * RandomVector(&random);
}

// The same cost by Ceres' automatic derivatives: parameters angle-axis and translation, log focal factor, point.
struct ReferenceCost {
  Observation observation;
  double noise_px;
  template <typename T>
  bool operator()(const T* angle_axis, const T* translation, const T* log_focal_factor, const T* point,
                  T* residual) const {
    T point_in_cam[3];
    ceres::AngleAxisRotatePoint(angle_axis, point, point_in_cam);
    T depth(0);
    residual[0] = residual[1] = T(0);
    for (int i = 0; i < 3; ++i) {
      point_in_cam[i] += translation[i];
      depth += observation.ray_in_cam(i) * point_in_cam[i];
      for (int row = 0; row < 2; ++row) residual[row] += observation.px_from_cam(row, i) * point_in_cam[i];
    }
    for (int row = 0; row < 2; ++row) {
      residual[row] = (residual[row] / depth + *log_focal_factor * observation.px_from_log_focal[row]) / noise_px;
    }
    return true;
  }
};

// Returns the views with poses and focal factors.
std::vector<View> SolveWithCeres(const BundleAdjustmentOptions& options, SyntheticTracks scene) {
  std::vector<std::array<double, 7>> poses(scene.views.size());
  ceres::Problem problem;
  for (size_t i = 0; i < poses.size(); ++i) {
    Eigen::Map<Eigen::Matrix<double, 7, 1>> pose(poses[i].data());
    pose << LogSO3(scene.views[i].cam_from_world.rotation), scene.views[i].cam_from_world.translation, 0;
  }
  for (Track& track : scene.tracks) {
    for (const TrackObservation& element : track.observations) {
      double* pose = poses[element.view].data();
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<ReferenceCost, 2, 3, 3, 1, 3>(
                                   new ReferenceCost{element.observation, scene.views[element.view].noise_px}),
                               new ceres::CauchyLoss(options.loss_scale_sigma), pose, pose + 3, pose + 6,
                               track.point_in_world.data());
      if (!scene.views[element.view].log_focal_factor) problem.SetParameterBlockConstant(pose + 6);
      if (!scene.views[element.view].is_database) continue;
      problem.SetParameterBlockConstant(pose);
      problem.SetParameterBlockConstant(pose + 3);
    }
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = ceres::DENSE_SCHUR;
  solver_options.max_num_iterations = 200;
  solver_options.function_tolerance = solver_options.parameter_tolerance = solver_options.gradient_tolerance = 1e-15;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  for (size_t i = 0; i < poses.size(); ++i) {
    Eigen::Map<Eigen::Matrix<double, 7, 1>> pose(poses[i].data());
    scene.views[i].cam_from_world = {ExpSO3(pose.head<3>()), pose.segment<3>(3)};
    if (scene.views[i].log_focal_factor) scene.views[i].log_focal_factor = pose[6];
  }
  return scene.views;
}

// Seeks the focal lengths of all queries but the last of several. Their rays are turned towards the optical axis as by
// a focal length too long, and the derivative by its log is such that log_focal_factor takes back exactly this.
void DisturbFocalLengths(double log_focal_factor, int num_query, SyntheticTracks* scene) {
  const int num_sought = std::max(1, num_query - 1);
  for (int query = 0; query < num_sought; ++query) scene->views[query].log_focal_factor = 0;
  for (Track& track : scene->tracks) {
    for (TrackObservation& element : track.observations) {
      if (element.view >= num_sought) continue;
      Observation& observation = element.observation;
      const Eigen::Vector3d point_in_cam = scene->views[element.view].cam_from_world * track.point_in_world;
      const Eigen::Vector2d noise_px = ReprojectionError(observation, point_in_cam);
      observation.ray_in_cam.head<2>() *= std::exp(-log_focal_factor);
      observation.ray_in_cam.normalize();
      observation.px_from_cam -= observation.px_from_cam * observation.ray_in_cam * observation.ray_in_cam.transpose();
      observation.px_from_log_focal = (noise_px - ReprojectionError(observation, point_in_cam)) / log_focal_factor;
    }
  }
}

class QueryCounts : public testing::TestWithParam<int> {
 protected:
  SyntheticTracks Make(double noise_px) const {
    SyntheticTracksOptions options;
    options.num_query = GetParam();
    options.noise_px = noise_px;
    options.min_views_ratio = 0.5;
    return MakeSyntheticTracks(options);
  }
};

TEST_P(QueryCounts, NoiseFreeIsExact) {
  const SyntheticTracks truth = Make(0);
  SyntheticTracks scene = truth;
  Disturb(&scene, 2, 0.2, 0.1);
  const StageSummary summary = AdjustBundle({}, &scene.views, &scene.tracks).summary;
  ASSERT_TRUE(summary.success) << summary.message;
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(scene.views[query].cam_from_world, truth.views[query].cam_from_world), 1e-8 * 8);
    EXPECT_LE(RotationErrorDeg(scene.views[query].cam_from_world, truth.views[query].cam_from_world), RadToDeg(1e-8));
  }
  for (size_t i = 0; i < truth.tracks.size(); ++i) {
    EXPECT_LE((scene.tracks[i].point_in_world - truth.tracks[i].point_in_world).norm(), 1e-7);
  }
}

TEST_P(QueryCounts, FocalLengthIsFoundExactlyWithoutNoise) {
  SyntheticTracks scene = Make(0);
  DisturbFocalLengths(0.1, GetParam(), &scene);
  const SyntheticTracks truth = scene;
  Disturb(&scene, 2, 0.2, 0.1);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-6;
  ASSERT_TRUE(AdjustBundle(options, &scene.views, &scene.tracks).summary.success);
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(scene.views[query].cam_from_world, truth.views[query].cam_from_world), 1e-7);
    const bool is_sought = query == 0 || query < GetParam() - 1;
    ASSERT_EQ(scene.views[query].log_focal_factor.has_value(), is_sought);
    EXPECT_NEAR(scene.views[query].log_focal_factor.value_or(0), is_sought ? 0.1 : 0, 1e-8);
  }
}

TEST_P(QueryCounts, FreeFocalLengthAgreesWithCeres) {
  SyntheticTracks scene = Make(1.5);
  DisturbFocalLengths(0.1, GetParam(), &scene);
  Disturb(&scene, 1, 0.1, 0.05);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-9;
  options.max_num_iterations = 500;
  const std::vector<View> reference = SolveWithCeres(options, scene);
  const std::vector<Eigen::Matrix<double, 6, 6>> covariances =
      AdjustBundle(options, &scene.views, &scene.tracks).pose_covariances;
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(scene.views[query].cam_from_world, reference[query].cam_from_world), 1e-5);
    if (!scene.views[query].log_focal_factor) continue;
    EXPECT_NEAR(*scene.views[query].log_focal_factor, *reference[query].log_focal_factor, 1e-6);
    EXPECT_GT(std::abs(*scene.views[query].log_focal_factor - 0.1), 1e-5) << "the noise has no effect";
  }
  // Not to know a focal length costs certainty of the pose.
  for (View& view : scene.views) view.log_focal_factor.reset();
  EXPECT_GT(covariances[0].trace(), AdjustBundle(options, &scene.views, &scene.tracks).pose_covariances[0].trace());
}

TEST_P(QueryCounts, AgreesWithCeres) {
  SyntheticTracks scene = Make(1.5);
  scene.views.back().noise_px = 3;
  Random random(5);
  for (int i = 0; i < 5; ++i) {  // gross outliers
    TrackObservation& element = scene.tracks[i].observations.back();
    element.observation = ObserveAt(scene.views[element.view].cam_from_world * scene.tracks[i].point_in_world, 500,
                                    30 * RandomVector(&random).head<2>());
  }
  Disturb(&scene, 1, 0.1, 0.05);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-9;
  options.max_num_iterations = 500;
  const std::vector<View> reference = SolveWithCeres(options, scene);
  ASSERT_TRUE(AdjustBundle(options, &scene.views, &scene.tracks).summary.success);
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(scene.views[query].cam_from_world, reference[query].cam_from_world), 1e-5);
    EXPECT_LE(RotationErrorDeg(scene.views[query].cam_from_world, reference[query].cam_from_world), 1e-4);
  }
}

TEST_P(QueryCounts, KeepsFixedViewsBitwise) {
  SyntheticTracks scene = Make(1);
  const std::vector<View> before = scene.views;
  Disturb(&scene, 1, 0.1, 0.1);
  ASSERT_TRUE(AdjustBundle({}, &scene.views, &scene.tracks).summary.success);
  for (size_t view = 0; view < before.size(); ++view) {
    if (!before[view].is_database) continue;
    EXPECT_EQ(scene.views[view].cam_from_world.rotation.coeffs(), before[view].cam_from_world.rotation.coeffs());
    EXPECT_EQ(scene.views[view].cam_from_world.translation, before[view].cam_from_world.translation);
  }
}

INSTANTIATE_TEST_SUITE_P(BundleAdjustment, QueryCounts, testing::Values(1, 3));

TEST(BundleAdjustment, PointBehindACameraFails) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.tracks[0].point_in_world = Eigen::Vector3d(0, 0, -1000);
  EXPECT_FALSE(AdjustBundle({}, &scene.views, &scene.tracks).summary.success);
}

TEST(BundleAdjustmentOptions, NamesTheInvalidField) {
  BundleAdjustmentOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.max_num_iterations = 0;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, testing::HasSubstr("max_num_iterations"));
}

}  // namespace
}  // namespace lazyloc
