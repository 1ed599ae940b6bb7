#include "colmap_lazyloc/testing/synthetic_video.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

constexpr double kQueryDistance = 0.5, kMaxPairDistance = 2;

struct VideoImage {
  std::string name;
  Rigid3d cam_from_world;
  std::vector<Eigen::Vector2d> keypoints;
  std::vector<uint32_t> point_ids;  // point of each keypoint, ascending
};

std::string Name(const char* prefix, int i) {
  const std::string number = std::to_string(i);
  return prefix + std::string(6 - number.size(), '0') + number;
}

class VideoMaker {
 public:
  explicit VideoMaker(const SyntheticVideoOptions& options) : options_(options), random_(options.seed) {
    camera_ = CameraFromFocalLength(*CameraModelId("SIMPLE_PINHOLE"), /*focal_length_px=*/800, 1280, 960);
    const double length = kQueryDistance * options.num_queries;
    std::uniform_real_distribution<double> x(-6, length + 6), y(-2, 2), z(4, 8);
    const int num_points = static_cast<int>(options.num_points_per_length * (length + 12));
    for (int i = 0; i < num_points; ++i) points_.emplace_back(x(random_), y(random_), z(random_));
    // Sorts along the path, so that the points that an image observes are neighbours in the list.
    std::sort(points_.begin(), points_.end(), [](const auto& a, const auto& b) { return a.x() < b.x(); });
  }

  SyntheticGroup Make() {
    SyntheticGroup video;
    std::vector<VideoImage> queries, database;
    const int num_database = static_cast<int>(std::ceil(kQueryDistance * options_.num_queries)) + 2;
    for (int i = 0; i < num_database; ++i) database.push_back(Take(Name("database", i), i - 1, 0.5));
    for (int i = 0; i < options_.num_queries; ++i) {
      queries.push_back(Take(Name("query", i), kQueryDistance * i, 0));
      const VideoImage& query = queries.back();
      QueryImage image;
      image.frame = i;
      video.group.frame_names.emplace_back();
      image.problem.query_name = query.name;
      image.problem.query_camera = camera_;
      image.problem.query_keypoints = query.keypoints;
      for (const VideoImage& other : database) {
        const double distance = std::abs(CamInWorld(other.cam_from_world).x() - CamInWorld(query.cam_from_world).x());
        if (distance < kMaxPairDistance) image.problem.pairs.push_back(Pair(query, other));
      }
      video.group.images.push_back(std::move(image));
      video.cam_from_world.push_back(query.cam_from_world);
      for (int other = std::max(0, i - 2); other < i; ++other) {
        video.group.query_pairs.push_back({i, other, Pair(query, queries[other])});
      }
    }
    return video;
  }

 private:
  VideoImage Take(const std::string& name, double x, double y) {
    VideoImage image;
    image.name = name;
    const Eigen::Vector3d centre = Eigen::Vector3d(x, y, 0) + 0.1 * RandomVector(&random_);
    image.cam_from_world = LookAt(centre, Eigen::Vector3d(x, 0, 6) + 0.2 * RandomVector(&random_));
    const auto begin = std::lower_bound(points_.begin(), points_.end(), x - 8,
                                        [](const Eigen::Vector3d& point, double bound) { return point.x() < bound; });
    for (auto point = begin; point != points_.end() && point->x() < x + 8; ++point) {
      const std::optional<Eigen::Vector2d> xy = ImageFromCam(camera_, image.cam_from_world * *point);
      const bool is_seen = xy && xy->x() > 0 && xy->y() > 0 && xy->x() < 1280 && xy->y() < 960;
      if (!is_seen) continue;
      image.keypoints.push_back(*xy + options_.pixel_noise_px * RandomVector(&random_).head<2>());
      image.point_ids.push_back(static_cast<uint32_t>(point - points_.begin()));
    }
    return image;
  }

  ImagePair Pair(const VideoImage& query, const VideoImage& other) const {
    ImagePair pair;
    pair.other_name = other.name;
    pair.other_camera = camera_;
    pair.database_cam_from_world = other.cam_from_world;
    pair.other_keypoints = other.keypoints;
    pair.geometry.emplace();
    pair.geometry->config = TwoViewConfig::CALIBRATED;
    pair.geometry->query_from_other = query.cam_from_world * Inverse(other.cam_from_world);
    pair.geometry->query_from_other->translation.normalize();
    for (uint32_t i = 0; i < query.point_ids.size(); ++i) {
      const auto found = std::lower_bound(other.point_ids.begin(), other.point_ids.end(), query.point_ids[i]);
      if (found == other.point_ids.end() || *found != query.point_ids[i]) continue;
      pair.geometry->inlier_matches.push_back({i, static_cast<uint32_t>(found - other.point_ids.begin())});
    }
    return pair;
  }

  const SyntheticVideoOptions& options_;
  Random random_;
  Camera camera_;
  std::vector<Eigen::Vector3d> points_;
};

}  // namespace

SyntheticGroup MakeSyntheticVideo(const SyntheticVideoOptions& options) { return VideoMaker(options).Make(); }

}  // namespace lazyloc
