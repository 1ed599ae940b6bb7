#include "colmap_lazyloc/priors/plane_orientation.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/scene/pose_distribution.h"
#include "colmap_lazyloc/testing/stage_input.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

constexpr double kFocalPx = 600;

Observation Observe(const Eigen::Vector3d& point_in_cam) {
  Observation observation;
  observation.ray_in_cam = point_in_cam.normalized();
  observation.px_from_cam = kFocalPx * TangentBasis(observation.ray_in_cam).transpose();
  return observation;
}

// A query and a database image that see points of an inclined plane, or of a volume.
struct TwoViews {
  Rigid3d query, database;
  std::vector<Track> tracks;
};

TwoViews MakeTwoViews(const Eigen::Vector3d& query_in_world, bool is_plane) {
  Random random(3);
  TwoViews views;
  views.query = CamFromWorld(ExpSO3({0.05, -0.1, 0.02}), query_in_world);
  views.database = CamFromWorld(ExpSO3({-0.02, 0.03, 0.1}), Eigen::Vector3d(0.1, -0.2, 0));
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d random_point = RandomVector(&random);
    Eigen::Vector3d point(random_point.x(), random_point.y(), 6 + 0.5 * random_point.x() - 0.2 * random_point.y());
    if (!is_plane) point.z() += random_point.z();
    Track track;
    track.point_in_world = point;
    track.observations.push_back({0, i, Observe(views.query * point)});
    track.observations.push_back({1, i, Observe(views.database * point)});
    views.tracks.push_back(track);
  }
  return views;
}

double ErrorOf(const Rigid3d& query_from_world, const TwoViews& views) {
  return SumSquaredErrors(query_from_world * Inverse(views.database), views.tracks, 0.5);
}

TEST(PlaneOrientation, TheOtherOneExplainsTheMatchesOfAPlaneAlike) {
  const TwoViews views = MakeTwoViews({0.1, 0, 1.5}, /*is_plane=*/true);
  const std::optional<Rigid3d> other = OtherOrientation(views.query, views.database, Refs(views.tracks));
  ASSERT_TRUE(other);
  EXPECT_GT(RotationErrorDeg(*other, views.query), 1);
  EXPECT_NEAR((CamInWorld(*other) - CamInWorld(views.database)).norm(),
              (CamInWorld(views.query) - CamInWorld(views.database)).norm(), 1e-9);
  EXPECT_LE(ErrorOf(views.query, views), 1e-9);
  EXPECT_LE(ErrorOf(*other, views), 1e-9);
}

TEST(PlaneOrientation, TheOtherOfTheOtherIsTheFirst) {
  TwoViews views = MakeTwoViews({0.1, 0, 1.5}, /*is_plane=*/true);
  const std::optional<Rigid3d> other = OtherOrientation(views.query, views.database, Refs(views.tracks));
  ASSERT_TRUE(other);
  for (Track& track : views.tracks) {
    const Eigen::Vector3d from_query = other->rotation.conjugate() * track.observations[0].observation.ray_in_cam;
    const Eigen::Vector3d from_database =
        views.database.rotation.conjugate() * track.observations[1].observation.ray_in_cam;
    // The rays meet at C_q + depth from_query.
    const Eigen::Vector3d baseline = CamInWorld(views.database) - CamInWorld(*other);
    const Eigen::Vector3d normal = from_query.cross(from_database);
    const double depth = baseline.cross(from_database).dot(normal) / normal.squaredNorm();
    track.point_in_world = CamInWorld(*other) + depth * from_query;
  }
  const std::optional<Rigid3d> first = OtherOrientation(*other, views.database, Refs(views.tracks));
  ASSERT_TRUE(first);
  EXPECT_LE(RotationErrorDeg(*first, views.query), 1e-6);
  EXPECT_LE(PositionError(*first, views.query), 1e-8);
}

TEST(PlaneOrientation, PointsBehindTheCamerasTellASidewaysMotion) {
  const TwoViews views = MakeTwoViews({1.5, 0, 0}, /*is_plane=*/true);
  const std::optional<Rigid3d> other = OtherOrientation(views.query, views.database, Refs(views.tracks));
  ASSERT_TRUE(other);
  EXPECT_GT(ErrorOf(*other, views), 100);
}

TEST(PlaneOrientation, PointsOutsideThePlaneTell) {
  const TwoViews views = MakeTwoViews({0.1, 0, 1.5}, /*is_plane=*/false);
  const std::optional<Rigid3d> other = OtherOrientation(views.query, views.database, Refs(views.tracks));
  ASSERT_TRUE(other);
  EXPECT_LE(ErrorOf(views.query, views), 1e-9);
  EXPECT_GT(ErrorOf(*other, views), 100);
}

SyntheticScene PlaneBesideOneImage(SceneLayout layout, uint32_t seed) {
  SyntheticSceneOptions options;
  options.layout = layout;
  options.num_database_images = 1;
  options.has_planar_points = true;
  options.pixel_noise_px = 0.5;
  options.seed = seed;
  return MakeSyntheticScene(options);
}

PositionPrior Around(const SyntheticScene& scene, double stddev) {
  return {CamInWorld(scene.query_cam_from_world) + Eigen::Vector3d(0.4, -0.5, 0.3) * stddev,
          stddev * stddev * Eigen::Matrix3d::Identity()};
}

double PositionSigma(const LocalizationResult& result, const SyntheticScene& scene) {
  const Eigen::Vector3d error = CamInWorld(result.cam_from_world) - CamInWorld(scene.query_cam_from_world);
  return std::sqrt(error.dot(
      MakePoseDistribution(result.cam_from_world, result.covariance).PositionCovariance().ldlt().solve(error)));
}

// Priors decide between orientations of a plane, or the query is refused, but is never put at the wrong one.
TEST(PlaneOrientation, NoPoseIsThatOfTheWrongOrientation) {
  int num_poses = 0;
  for (const SceneLayout layout : {SceneLayout::RING, SceneLayout::FORWARD}) {
    for (uint32_t seed = 0; seed < 20; ++seed) {
      SyntheticScene scene = PlaneBesideOneImage(layout, seed);
      scene.problem.prior.position = Around(scene, 0.3);
      const LocalizationResult result = LocalizeQuery(scene.problem, WithExactDatabase());
      if (!HasPose(result.status)) {
        EXPECT_EQ(result.status, QueryStatus::SCALE_UNOBSERVABLE) << result.reason;
        continue;
      }
      ++num_poses;
      EXPECT_LE(PositionSigma(result, scene), 4) << seed;
      EXPECT_LE(AngularDistanceRad(result.cam_from_world.rotation, scene.query_cam_from_world.rotation),
                4.5 * result.spread.rotation_stddev_rad);
    }
  }
  EXPECT_GE(num_poses, 20);
}

// Ahead on the optical axis, the points are in front of the camera in both orientations. A vague position says nothing
// of these; gravity does, unless they differ by a turn about it.
TEST(PlaneOrientation, GravityDecidesWhatAPositionLeavesOpen) {
  int num_undecided = 0, num_decided = 0;
  for (uint32_t seed = 0; seed < 20; ++seed) {
    SyntheticScene scene = PlaneBesideOneImage(SceneLayout::FORWARD, seed);
    scene.problem.prior.position = Around(scene, 20);
    const LocalizationResult by_position = LocalizeQuery(scene.problem, WithExactDatabase());
    if (by_position.reason.find("two orientations") == std::string::npos) continue;
    ++num_undecided;
    const Eigen::Vector3d down(0, 0, -1);
    scene.problem.prior.gravity = {scene.query_cam_from_world.rotation * down, down, DegToRad(0.3)};
    const LocalizationResult by_gravity = LocalizeQuery(scene.problem, WithExactDatabase());
    if (!HasPose(by_gravity.status)) continue;
    ++num_decided;
    EXPECT_LE(RotationErrorDeg(by_gravity.cam_from_world, scene.query_cam_from_world), 2);
  }
  EXPECT_GE(num_undecided, 10);
  EXPECT_GE(num_decided, 0.75 * num_undecided);
}

}  // namespace
}  // namespace lazyloc
