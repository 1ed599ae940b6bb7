#include "colmap_lazyloc/testing/synthetic_scene.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

Camera MakeCamera(bool is_query) {
  Camera camera;
  camera.width = 1280;
  camera.height = 960;
  if (is_query) {
    camera.model_id = *CameraModelId("PINHOLE");
    camera.params = {900, 910, 640, 480};
  } else {
    camera.model_id = *CameraModelId("SIMPLE_PINHOLE");
    camera.params = {800, 640, 480};
  }
  return camera;
}

// Returns the pose of a database image in a layout, or of the query if index is -1, in scene units.
Rigid3d MakePose(SceneLayout layout, int index, int num_database_images, Random* random) {
  const double fraction = (index + 0.5) / num_database_images;
  const Eigen::Vector3d jitter = 0.3 * RandomVector(random);
  const Eigen::Vector3d target = 0.3 * RandomVector(random);
  const Eigen::Vector3d line(8 * fraction - 4, 0, -10);
  switch (layout) {
    case SceneLayout::RING: {
      const double angle = index < 0 ? 0.4 : 2 * M_PI * fraction / 3;
      const double radius = index < 0 ? 8 : 10;
      return LookAt(Eigen::Vector3d(radius * std::sin(angle), 0, -radius * std::cos(angle)) + jitter, target);
    }
    case SceneLayout::LINE: return LookAt(index < 0 ? Eigen::Vector3d(1, -1.5, -9) : line, target);
    case SceneLayout::LINE_ON_LINE: return LookAt(index < 0 ? Eigen::Vector3d(0.7, 0, -10) : line, target);
    case SceneLayout::FORWARD: return LookAt(Eigen::Vector3d(0, 0, index < 0 ? -9.1 : -14 + 8 * fraction), {0, 0, 100});
    case SceneLayout::PURE_ROTATION: return LookAt({0, 0, -10}, target);
    case SceneLayout::SAME_PLACE: return LookAt(index <= 0 ? Eigen::Vector3d(0, 0, -10) : line, target);
  }
  return {};
}

std::vector<Eigen::Vector3d> MakePoints(int num_points, bool are_planar, Random* random) {
  std::uniform_real_distribution<double> uniform(-2.5, 2.5);
  std::vector<Eigen::Vector3d> points(num_points);
  for (Eigen::Vector3d& point : points) {
    point = {uniform(*random), uniform(*random), uniform(*random)};
    if (are_planar) point.z() = 0.4 * point.x() + 0.2 * point.y();
  }
  return points;
}

std::vector<Eigen::Vector2d> Project(const std::vector<Eigen::Vector3d>& points, const Camera& camera,
                                     const Rigid3d& cam_from_world, double noise_px, Random* random) {
  std::normal_distribution<double> noise(0, 1);
  std::vector<Eigen::Vector2d> keypoints;
  for (const Eigen::Vector3d& point : points) {
    const std::optional<Eigen::Vector2d> xy = ImageFromCam(camera, cam_from_world * point);
    LAZYLOC_CHECK(xy.has_value());
    keypoints.push_back(*xy + noise_px * Eigen::Vector2d{noise(*random), noise(*random)});
  }
  return keypoints;
}

// Matches keypoint i of both images, which is point i, except for num_outliers random points, which are matched to one
// another's keypoints.
Matches MakeMatches(int num_points, int num_outliers, Random* random) {
  std::vector<uint32_t> order(num_points), other_points(num_points);
  std::iota(order.begin(), order.end(), 0u);
  std::shuffle(order.begin(), order.end(), *random);
  std::iota(other_points.begin(), other_points.end(), 0u);
  for (int i = 0; i < num_outliers; ++i) {
    other_points[order[num_points - 1 - i]] = order[num_points - 1 - (i + 1) % num_outliers];
  }
  Matches matches;
  for (uint32_t point = 0; point < other_points.size(); ++point) matches.push_back({point, other_points[point]});
  return matches;
}

TwoViewGeometry MakeGeometry(const Rigid3d& query_from_other, const SyntheticSceneOptions& options, bool is_outlier,
                             const Matches& matches, Random* random) {
  TwoViewGeometry geometry;
  geometry.config = TwoViewConfig::CALIBRATED;
  geometry.inlier_matches = matches;
  Rigid3d pose = query_from_other;
  if (is_outlier) {
    pose = {RandomRotation(random), RandomVector(random)};
  } else {
    pose.rotation = Disturbed(pose.rotation, options.rotation_noise_deg, random);
    pose.translation = DisturbedDirection(pose.translation, options.direction_noise_deg, random);
  }
  if (pose.translation.norm() < 1e-9) {
    geometry.config = TwoViewConfig::PANORAMIC;
    pose.translation.setZero();
  } else {
    pose.translation.normalize();
  }
  geometry.query_from_other = pose;
  return geometry;
}

// Converts a pose from scene units around zero to database units around options.origin.
Rigid3d Placed(const Rigid3d& cam_from_scene, const SyntheticSceneOptions& options) {
  return CamFromWorld(cam_from_scene.rotation, options.unit * CamInWorld(cam_from_scene) + options.origin);
}

}  // namespace

SyntheticScene MakeSyntheticScene(const SyntheticSceneOptions& options) {
  Random random(options.seed);
  const std::vector<Eigen::Vector3d> points = MakePoints(options.num_points, options.has_planar_points, &random);
  const Rigid3d query = MakePose(options.layout, -1, options.num_database_images, &random);
  SyntheticScene scene;
  scene.query_cam_from_world = Placed(query, options);
  scene.problem.query_name = "query.jpg";
  scene.problem.query_camera = MakeCamera(/*is_query=*/true);
  scene.problem.query_keypoints = Project(points, scene.problem.query_camera, query, options.pixel_noise_px, &random);
  scene.num_outlier_pairs = static_cast<int>(std::lround(options.outlier_pair_ratio * options.num_database_images));
  for (int i = 0; i < options.num_database_images; ++i) {
    const Rigid3d database = MakePose(options.layout, i, options.num_database_images, &random);
    const bool is_outlier = i < scene.num_outlier_pairs;
    ImagePair pair;
    pair.other_name = Format("database%04d.jpg", i);
    pair.other_camera = MakeCamera(/*is_query=*/false);
    pair.database_cam_from_world = Placed(database, options);
    pair.other_keypoints = Project(points, pair.other_camera, database, options.pixel_noise_px, &random);
    const double outlier_ratio = is_outlier ? 1 : options.outlier_match_ratio;
    const Matches matches =
        MakeMatches(options.num_points, static_cast<int>(outlier_ratio * options.num_points), &random);
    const TwoViewGeometry geometry = MakeGeometry(query * Inverse(database), options, is_outlier, matches, &random);
    if (options.has_geometry) {
      pair.geometry = geometry;
    } else {
      pair.matches = matches;
    }
    scene.problem.pairs.push_back(std::move(pair));
  }
  std::vector<double> depths;
  for (const Eigen::Vector3d& point : points) depths.push_back(options.unit * (query * point).norm());
  std::sort(depths.begin(), depths.end());
  scene.median_depth = depths[depths.size() / 2];
  return scene;
}

Eigen::Vector3d RandomVector(Random* random) {
  std::normal_distribution<double> normal;
  const double x = normal(*random), y = normal(*random), z = normal(*random);
  return {x, y, z};
}

Eigen::Quaterniond RandomRotation(Random* random) {
  std::normal_distribution<double> normal;
  const double w = normal(*random);
  const Eigen::Vector3d xyz = RandomVector(random);
  return Eigen::Quaterniond(w, xyz.x(), xyz.y(), xyz.z()).normalized();
}

Eigen::Quaterniond Disturbed(const Eigen::Quaterniond& rotation, double angle_deg, Random* random) {
  return ExpSO3(DegToRad(angle_deg) * RandomVector(random).normalized()) * rotation;
}

Eigen::Vector3d DisturbedDirection(const Eigen::Vector3d& direction, double angle_deg, Random* random) {
  if (angle_deg == 0 || direction.isZero()) return direction;
  const Eigen::Vector3d axis = direction.cross(RandomVector(random)).normalized();
  return ExpSO3(DegToRad(angle_deg) * axis) * direction;
}

Rigid3d LookAt(const Eigen::Vector3d& cam_in_world, const Eigen::Vector3d& target_in_world) {
  const Eigen::Vector3d forward = (target_in_world - cam_in_world).normalized();
  const Eigen::Vector3d right = Eigen::Vector3d(0, 1, 0).cross(forward).normalized();
  Eigen::Matrix3d cam_from_world;
  cam_from_world << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  return CamFromWorld(Eigen::Quaterniond(cam_from_world), cam_in_world);
}

double PositionError(const Rigid3d& a, const Rigid3d& b) { return (CamInWorld(a) - CamInWorld(b)).norm(); }

double RotationErrorDeg(const Rigid3d& a, const Rigid3d& b) {
  return RadToDeg(AngularDistanceRad(a.rotation, b.rotation));
}

}  // namespace lazyloc
