#include "colmap_lazyloc/bridge/joint_triangulation.h"

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>

#include <colmap/sfm/incremental_triangulator.h>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/bridge/random_numbers.h"
#include "colmap_lazyloc/bridge/reconstruction_building.h"

namespace lazyloc {
namespace {

// Returns the images that have matches, because COLMAP's graph drops the others and then fails to find them.
std::vector<bool> HaveMatches(const JointScene& scene) {
  std::vector<bool> have_matches(scene.images.size(), false);
  for (const JointPair& pair : scene.pairs) {
    if (!pair.matches.empty()) have_matches[pair.image1] = have_matches[pair.image2] = true;
  }
  return have_matches;
}

// Adds the images that have matches. Ids are indices plus 1.
void AddScene(const JointScene& scene, const std::vector<bool>& have_matches, colmap::Reconstruction* reconstruction,
              colmap::CorrespondenceGraph* graph) {
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    colmap::Camera camera = ToColmap(scene.cameras[i].camera);
    camera.camera_id = static_cast<colmap::camera_t>(i + 1);
    AddCamera(camera, reconstruction);
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (!have_matches[i]) continue;
    const JointImage& image = scene.images[i];
    colmap::Image converted;
    converted.SetImageId(static_cast<colmap::image_t>(i + 1));
    converted.SetCameraId(static_cast<colmap::camera_t>(image.camera + 1));
    converted.SetName(std::to_string(i));
    converted.SetPoints2D(image.keypoints);
    AddPosedImage(std::move(converted), ToColmap(image.cam_from_world), reconstruction);
    graph->AddImage(static_cast<colmap::image_t>(i + 1), image.keypoints.size());
  }
  for (const JointPair& pair : scene.pairs) {
    if (pair.matches.empty()) continue;
    AddMatches(pair.image1 + 1, pair.image2 + 1, ToColmap(pair.matches), graph);
  }
  graph->Finalize();
}

// Returns the points in the order of their first observations, because COLMAP keeps them in a hash map. Of several
// observations in an image, keeps the first.
std::vector<JointPoint> ReadPoints(const colmap::Reconstruction& reconstruction) {
  std::map<std::pair<int, uint32_t>, JointPoint> points;
  for (const auto& id_and_point : reconstruction.Points3D()) {
    JointPoint point;
    point.point_in_world = id_and_point.second.xyz;
    std::set<std::pair<int, uint32_t>> elements;
    for (const colmap::TrackElement& element : id_and_point.second.track.Elements()) {
      elements.emplace(static_cast<int>(element.image_id) - 1, element.point2D_idx);
    }
    for (const auto& [image, keypoint] : elements) {
      if (!point.observations.empty() && point.observations.back().image == image) continue;
      point.observations.push_back({image, keypoint});
    }
    if (point.observations.size() >= 2) points.emplace(*elements.begin(), std::move(point));
  }
  std::vector<JointPoint> sorted;
  sorted.reserve(points.size());
  for (auto& key_and_point : points) sorted.push_back(std::move(key_and_point.second));
  return sorted;
}

}  // namespace

std::vector<JointPoint> TriangulateJointly(const JointScene& scene, double max_error_px) {
  SeedRandomNumbers(0);
  colmap::Reconstruction reconstruction;
  const auto graph = std::make_shared<colmap::CorrespondenceGraph>();
  const std::vector<bool> have_matches = HaveMatches(scene);
  AddScene(scene, have_matches, &reconstruction, graph.get());
  double focal_length_px = std::numeric_limits<double>::infinity();
  for (const JointCamera& camera : scene.cameras) {
    focal_length_px = std::min(focal_length_px, MeanFocalLength(camera.camera));
  }
  colmap::IncrementalTriangulator::Options options;
  options.create_max_angle_error = options.continue_max_angle_error = 57.29578 * max_error_px / focal_length_px;
  options.merge_max_reproj_error = options.complete_max_reproj_error = max_error_px;
  options.ignore_two_view_tracks = false;
  // Behind a long lens, a coefficient of the distortion may be larger than COLMAP takes for possible.
  options.max_extra_param = std::numeric_limits<double>::max();
  colmap::IncrementalTriangulator triangulator(graph, reconstruction);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (have_matches[i] && !scene.images[i].is_database)
      triangulator.TriangulateImage(options, static_cast<colmap::image_t>(i + 1));
  }
  triangulator.CompleteAllTracks(options);
  triangulator.MergeAllTracks(options);
  return ReadPoints(reconstruction);
}

}  // namespace lazyloc
