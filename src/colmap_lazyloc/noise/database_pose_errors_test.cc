#include "colmap_lazyloc/noise/database_pose_errors.h"

#include <cmath>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/database_priors.h"
#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

constexpr double kFocalLengthPx = 500, kDistance = 6;
const Camera kCamera{1, 0, 640, 480, {kFocalLengthPx, 320, 240}, true};

Rigid3d OnArc(double angle_rad) {
  return LookAt({kDistance * std::sin(angle_rad), 0.3 * std::sin(7 * angle_rad), -kDistance * std::cos(angle_rad)},
                {0, 0, 0});
}

Rigid3d WithError(const Rigid3d& pose, double error_px, Random* random) {
  const double error_rad = error_px / kFocalLengthPx;
  return CamFromWorld(ExpSO3(error_rad * RandomVector(random)) * pose.rotation,
                      CamInWorld(pose) + kDistance * error_rad * RandomVector(random));
}

// Returns a query with one database image, which has matches with six others on an arc. All database poses have
// independent errors of this size.
QueryGroup MakeGroup(double error_px, uint32_t seed) {
  Random random(seed);
  std::normal_distribution<double> noise(0, 0.5);
  ImagePair pair;
  pair.other_name = "database";
  pair.other_camera = kCamera;
  pair.database_cam_from_world = WithError(OnArc(0), error_px, &random);
  for (const double angle : {-0.3, -0.2, -0.1, 0.1, 0.2, 0.3}) {
    NeighbourPair neighbour;
    neighbour.camera = kCamera;
    neighbour.cam_from_world = WithError(OnArc(angle), error_px, &random);
    for (int i = 0; i < 150; ++i) {
      const Eigen::Vector3d point = RandomVector(&random);
      const auto project = [&](const Rigid3d& pose) -> Eigen::Vector2d {
        const Eigen::Vector2d error{noise(random), noise(random)};
        return kFocalLengthPx * (pose * point).hnormalized() + Eigen::Vector2d(320, 240) + error;
      };
      neighbour.points.push_back(project(OnArc(0)));
      neighbour.other_points.push_back(project(OnArc(angle)));
    }
    pair.neighbours.push_back(neighbour);
  }
  QueryGroup group;
  group.frame_names = {""};
  group.images.emplace_back();
  group.images[0].problem.pairs = {pair};
  return group;
}

// Returns the root mean square of the error that is expected at a viewpoint 0.1 away, over some databases.
double ExpectedPx(double error_px) {
  double squares = 0;
  constexpr int kNumDatabases = 10;
  for (int seed = 0; seed < kNumDatabases; ++seed) {
    const ExpectedPoseErrors errors = MeasurePoseErrors(MakeGroup(error_px, seed), {}).at(0);
    EXPECT_EQ(errors.source, PoseNoiseSource::DATABASE_PAIRS);
    EXPECT_EQ(errors.num_pairs, 6);
    const DatabasePoseNoise noise = errors.AsResult();
    const double independent = (std::pow(noise.rotation_px, 2) + std::pow(noise.position_px, 2)) / 2;
    squares += (std::pow(noise.viewpoint_px, 2) * std::pow(0.5, 1.5) + independent) / kNumDatabases;
  }
  return std::sqrt(squares);
}

TEST(MeasurePoseErrors, IsAsLargeAsTheErrorsOfTheDatabase) {
  EXPECT_LT(ExpectedPx(0), 0.3);
  for (const double error_px : {1, 3, 6}) {
    const double expected_px = ExpectedPx(error_px);
    EXPECT_GT(expected_px, 0.6 * error_px) << error_px;
    EXPECT_LT(expected_px, 1.7 * error_px) << error_px;
  }
}

TEST(MeasurePoseErrors, StatedSizesStay) {
  const QueryGroup group = MakeGroup(6, 0);
  LocalizerOptions options;
  options.database_pose_stddev_deg = 0;
  EXPECT_EQ(MeasurePoseErrors(group, options).at(0).source, PoseNoiseSource::STATED);
  EXPECT_EQ(MeasurePoseErrors(group, options).at(0).AsResult().viewpoint_px, 0);
}

TEST(MeasurePoseErrors, DefaultWithoutUsablePairs) {
  QueryGroup group = MakeGroup(6, 0);
  const auto expect_default = [&] {
    const ExpectedPoseErrors errors = MeasurePoseErrors(group, {}).at(0);
    EXPECT_EQ(errors.source, PoseNoiseSource::DEFAULT);
    EXPECT_EQ(errors.num_pairs, 0);
    EXPECT_EQ(errors.AsResult().viewpoint_px, 0.7);
  };
  for (NeighbourPair& neighbour : group.images[0].problem.pairs[0].neighbours) {
    neighbour.points.resize(10);
    neighbour.other_points.resize(10);
  }
  expect_default();
  group.images[0].problem.pairs[0].neighbours.clear();
  expect_default();
}

TEST(MeasurePoseErrors, PriorsExpectThem) {
  SyntheticGroupOptions options;
  options.num_frames = options.num_sensors = 1;
  StageInput input = MakeStageInput(MakeSyntheticGroup(options));
  input.layout.expected_pose_errors = MeasurePoseErrors(MakeGroup(6, 0), {});
  const DatabasePriors priors(input.layout, {});
  priors.Set(MeasureFrameScales(input.truth, input.tracks), &input.truth);
  const DatabasePoseNoise noise = input.layout.expected_pose_errors[0].AsResult();
  const PriorGroup& group = input.truth.prior_groups.at(0);
  EXPECT_DOUBLE_EQ(group.components[0].variance, noise.viewpoint_px * noise.viewpoint_px);
  EXPECT_DOUBLE_EQ(group.components[1].variance, noise.rotation_px * noise.rotation_px);
  EXPECT_DOUBLE_EQ(group.components[2].variance, noise.position_px * noise.position_px);
}

}  // namespace
}  // namespace lazyloc
