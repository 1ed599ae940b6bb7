// Localizes a query from data structures, without a database or files. The example projects a synthetic scene into five
// posed images and the query. In your program, keypoints and matches come from your features and matcher.
#include <cstdlib>
#include <iostream>
#include <random>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"

namespace {

lazyloc::Camera MakeCamera() {
  lazyloc::Camera camera;
  camera.camera_id = 1;
  camera.model_id = *lazyloc::CameraModelId("PINHOLE");
  camera.width = 640;
  camera.height = 480;
  camera.params = {500, 500, 320, 240};  // fx fy cx cy, in COLMAP's order
  return camera;
}

std::vector<Eigen::Vector3d> MakePoints() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> coordinate(-1, 1);
  std::vector<Eigen::Vector3d> points_in_world;
  for (int i = 0; i < 200; ++i) {
    points_in_world.emplace_back(coordinate(random), coordinate(random), 6 + coordinate(random));
  }
  return points_in_world;
}

// Returns the keypoints of all points, in the order of the points, so that keypoints with equal indices match.
std::vector<Eigen::Vector2d> Project(const lazyloc::Camera& camera, const lazyloc::Rigid3d& cam_from_world,
                                     const std::vector<Eigen::Vector3d>& points_in_world) {
  std::vector<Eigen::Vector2d> keypoints;
  for (const Eigen::Vector3d& point : points_in_world) {
    keypoints.push_back(*lazyloc::ImageFromCam(camera, cam_from_world * point));
  }
  return keypoints;
}

}  // namespace

int main() {
  const lazyloc::Camera camera = MakeCamera();
  const std::vector<Eigen::Vector3d> points_in_world = MakePoints();
  const Eigen::Quaterniond turned(Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()));
  const lazyloc::Rigid3d true_cam_from_world = lazyloc::CamFromWorld(turned, Eigen::Vector3d(0.3, -0.2, 0.1));

  lazyloc::LocalizationProblem problem;
  problem.query_name = "query";
  problem.query_camera = camera;
  problem.query_keypoints = Project(camera, true_cam_from_world, points_in_world);
  for (int i = 0; i < 5; ++i) {
    const Eigen::Vector3d cam_in_world(i - 2.0, 0.5 * (i % 2), 0);
    lazyloc::ImagePair pair;
    pair.other_name = "database_" + std::to_string(i);
    pair.other_camera = camera;
    pair.database_cam_from_world = lazyloc::CamFromWorld(Eigen::Quaterniond::Identity(), cam_in_world);
    pair.other_keypoints = Project(camera, pair.database_cam_from_world, points_in_world);
    for (uint32_t k = 0; k < points_in_world.size(); ++k) pair.matches.push_back({k, k});
    problem.pairs.push_back(pair);
  }

  const lazyloc::LocalizationResult result = lazyloc::LocalizeQuery(problem, lazyloc::LocalizerOptions());
  std::cout << lazyloc::QueryStatusName(result.status) << " " << result.reason << "\n";
  if (result.status != lazyloc::QueryStatus::LOCALIZED) return EXIT_FAILURE;

  const Eigen::Vector3d cam_in_world = lazyloc::CamInWorld(result.cam_from_world);
  const double error = (cam_in_world - lazyloc::CamInWorld(true_cam_from_world)).norm();
  std::cout << "camera at " << cam_in_world.transpose() << ", off by " << error << "\n";
  return error < 1e-4 ? EXIT_SUCCESS : EXIT_FAILURE;
}
