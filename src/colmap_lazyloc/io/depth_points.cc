#include "colmap_lazyloc/io/depth_points.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/bridge/observation.h"
#include "colmap_lazyloc/io/database_neighbours.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Minimum angle between two rays in rad (3 degrees), because points of smaller angles are less exact than depth maps.
constexpr double kMinAngleRad = 0.052;
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
  const Eigen::Vector3d normal = ray_a.cross(ray_b);
  const double angle_rad = std::atan2(normal.norm(), ray_a.dot(ray_b));
  if (angle_rad < kMinAngleRad) return std::nullopt;
  // Takes the point of the camera's own ray that is nearest to the other one.
  const Eigen::Vector3d baseline = CamInWorld(other.cam_from_world) - CamInWorld(camera.cam_from_world);
  const double distance = baseline.cross(ray_b).dot(normal) / normal.squaredNorm();
  const Eigen::Vector3d in_b = other.cam_from_world * (CamInWorld(camera.cam_from_world) + distance * ray_a);
  const double depth = distance * a->ray_in_cam.z();
  if (!(depth > 0) || !IsInFront(*b, in_b) || ReprojectionError(*b, in_b).norm() > kMaxErrorPx) return std::nullopt;
  return DepthAndAngle{depth, angle_rad};
}

}  // namespace

DepthPoints::DepthPoints(const QuerySelection& selection)
    : selection_(selection), cache_(kNeighbourCacheBytes, [](const std::vector<float>& depths) {
        return sizeof(float) * (16 + depths.size());
      }) {}

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
