#include "colmap_lazyloc/loading/depth_points.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/bridge/observation.h"
#include "colmap_lazyloc/loading/database_neighbours.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Minimum sine of the angle between two rays (3 degrees), because points of smaller angles are less exact than depth
// maps.
constexpr double kMinDepthSine = 0.052;
constexpr double kMaxErrorPx = 4;

// A posed image whose keypoints become rays.
struct PosedCamera {
  PosedCamera(const Model& model, const ModelImage& image)
      : observe(model.cameras.at(image.camera_id)), cam_from_world(image.cam_from_world) {
    cam_from_world.rotation.normalize();
  }

  Observer observe;
  Rigid3d cam_from_world;
};

// The point of two keypoints, as a camera sees it.
struct DepthAndAngle {
  double depth = 0;
  double angle_rad = 0;
};

std::optional<DepthAndAngle> TriangulateDepth(const PosedCamera& camera, const Eigen::Vector2d& xy,
                                              const PosedCamera& other, const Eigen::Vector2d& other_xy) {
  const std::optional<Observation> a = camera.observe(xy), b = other.observe(other_xy);
  if (!a || !b) return std::nullopt;
  const Eigen::Vector3d ray_a = camera.cam_from_world.rotation.conjugate() * a->ray_in_cam;
  const Eigen::Vector3d ray_b = other.cam_from_world.rotation.conjugate() * b->ray_in_cam;
  const Eigen::Vector3d centre = CamInWorld(camera.cam_from_world);
  const auto nearest = FindNearestPoints(ray_a, ray_b, CamInWorld(other.cam_from_world) - centre, kMinDepthSine);
  if (!nearest) return std::nullopt;
  // Takes the point of the camera's own ray.
  const Eigen::Vector3d in_b = other.cam_from_world * (centre + nearest->distance1 * ray_a);
  const double depth = nearest->distance1 * a->ray_in_cam.z();
  if (!(depth > 0) || !IsInFront(*b, in_b) || ReprojectionError(*b, in_b).norm() > kMaxErrorPx) return std::nullopt;
  return DepthAndAngle{depth, AngleBetweenRad(ray_a, ray_b)};
}

}  // namespace

DepthPoints::DepthPoints(const QuerySelection& selection)
    : selection_(selection),
      cache_([](const std::vector<float>& depths) { return sizeof(float) * (16 + depths.size()); }) {}

std::vector<float> DepthPoints::Triangulate(const ModelImage& image, uint32_t image_id, const std::string& query_name,
                                            const DatabaseReader& database) const {
  const Model& model = selection_.DatabaseModel();
  const PosedCamera camera(model, image);
  const std::vector<Eigen::Vector2d> keypoints = database.ReadKeypoints(image_id);
  std::vector<DepthAndAngle> best(keypoints.size());
  for (const auto& [other_id, neighbour] : FindNeighbours(selection_, image_id, query_name, database)) {
    try {
      const std::optional<TwoViewGeometry> geometry = database.ReadTwoViewGeometry(image_id, other_id);
      if (!geometry) continue;
      const PosedCamera other(model, *neighbour);
      const std::vector<Eigen::Vector2d> other_keypoints = database.ReadKeypoints(other_id);
      for (const Match& match : geometry->inlier_matches) {
        if (match.query_point >= keypoints.size() || match.other_point >= other_keypoints.size()) continue;
        const auto found =
            TriangulateDepth(camera, keypoints[match.query_point], other, other_keypoints[match.other_point]);
        if (found && found->angle_rad > best[match.query_point].angle_rad) best[match.query_point] = *found;
      }
    } catch (const DamagedRecordError&) {
      // Goes on without the pair, as for queries.
      continue;
    }
  }
  std::vector<float> depths;
  for (const DepthAndAngle& point : best) depths.push_back(static_cast<float>(point.depth));
  return depths;
}

std::vector<float> DepthPoints::AtKeypoints(const std::string& image_name, const std::string& query_name,
                                            const DatabaseReader& database) const {
  const DatabaseImage* stored = selection_.FindInDatabase(image_name);
  const ModelImage* image = stored == nullptr ? nullptr : selection_.FindPosedImage(stored->image_id, query_name);
  if (image == nullptr) return {};
  const auto triangulate = [&] { return Triangulate(*image, stored->image_id, query_name, database); };
  // The points of a query that is itself a posed image are its own, because it takes no part in them.
  return selection_.HasPosedQueries() ? triangulate() : *cache_.Get(stored->image_id, triangulate);
}

}  // namespace lazyloc
