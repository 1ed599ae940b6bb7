#include "colmap_lazyloc/loading/database_neighbours.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

#include "colmap_lazyloc/bridge/observer.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {
namespace {

// Numbers of database images, and of keypoints that two or more of them match, from which on the query's own tracks
// tell the size of the errors.
constexpr size_t kEnoughImages = 3;
constexpr int kEnoughPoints = 200;
// Maximum number of other images that an image is paired with, and of matches of a pair that are used.
constexpr int kMaxNumNeighbours = 6;
constexpr size_t kMaxNumMatches = 200;
// Minimum sine of the angle between two rays (3 degrees), because points of smaller angles are less exact than depth
// maps.
constexpr double kMinDepthSine = 0.052;
constexpr double kMaxErrorPx = 4;

int NumMatches(const ImagePair& pair) {
  return static_cast<int>(pair.geometry ? pair.geometry->inlier_matches.size() : pair.matches.size());
}

// Returns how many keypoints of a query match two or more database images.
int NumCommonPoints(const std::vector<ImagePair>& pairs) {
  std::map<uint32_t, int> num_images;  // by keypoint
  for (const ImagePair& pair : pairs) {
    if (NumMatches(pair) < kMinNumInliers) continue;
    for (const Match& match : pair.geometry ? pair.geometry->inlier_matches : pair.matches) {
      ++num_images[match.query_point];
    }
  }
  return static_cast<int>(
      std::count_if(num_images.begin(), num_images.end(), [](const auto& entry) { return entry.second > 1; }));
}

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

size_t NumBytes(const std::vector<NeighbourPair>& pairs) {
  size_t num_points = 16;
  for (const NeighbourPair& pair : pairs) num_points += 16 + pair.points.size();
  return 2 * sizeof(Eigen::Vector2d) * num_points;
}

}  // namespace

DatabaseNeighbours::DatabaseNeighbours(const QuerySelection& selection)
    : selection_(selection),
      pairs_(NumBytes),
      matched_pairs_(NumBytes),
      depths_([](const std::vector<float>& depths) { return sizeof(float) * (16 + depths.size()); }) {}

void DatabaseNeighbours::ForEachNeighbour(uint32_t image_id, const std::string& query_name,
                                          const DatabaseReader& database, const VisitNeighbour& visit) const {
  std::vector<PairSize> sizes = database.ReadInlierCounts(image_id, selection_.PosedImageIds());
  std::sort(sizes.begin(), sizes.end(), [](const PairSize& a, const PairSize& b) {
    return std::tie(b.num_matches, a.image_id) < std::tie(a.num_matches, b.image_id);
  });
  int num_neighbours = 0;
  for (const PairSize& size : sizes) {
    const ModelImage* other = selection_.FindPosedImage(size.image_id, query_name);
    if (other == nullptr || size.image_id == image_id) continue;
    if (num_neighbours++ == kMaxNumNeighbours) return;
    try {
      const std::optional<TwoViewGeometry> geometry = database.ReadTwoViewGeometry(image_id, size.image_id);
      if (geometry) visit(*other, geometry->inlier_matches, database.ReadKeypoints(size.image_id));
    } catch (const DamagedRecordError&) {
      continue;  // goes on without the pair, as for queries
    }
  }
}

std::optional<NeighbourPair> DatabaseNeighbours::MakeNeighbourPair(
    const ModelImage& image, const std::vector<Eigen::Vector2d>& points, const ModelImage& other,
    const Matches& matches, const std::vector<Eigen::Vector2d>& other_points) const {
  const std::string frame_name = selection_.MakePair(image).database_frame_name;
  const ImagePair with_other = selection_.MakePair(other);
  if (matches.empty() || (!frame_name.empty() && with_other.database_frame_name == frame_name)) return std::nullopt;
  NeighbourPair pair{with_other.other_camera, other.cam_from_world, {}, {}};
  const size_t num = std::min(matches.size(), kMaxNumMatches);  // evenly chosen ones if there are more
  for (size_t i = 0; i < num; ++i) {
    const Match& match = matches[i * matches.size() / num];
    if (match.query_point >= points.size() || match.other_point >= other_points.size()) return std::nullopt;
    pair.points.push_back(points[match.query_point]);
    pair.other_points.push_back(other_points[match.other_point]);
  }
  return pair;
}

std::vector<NeighbourPair> DatabaseNeighbours::Read(const ModelImage& image, uint32_t image_id,
                                                    const std::string& query_name,
                                                    const DatabaseReader& database) const {
  const std::vector<Eigen::Vector2d> points = database.ReadKeypoints(image_id);
  std::vector<NeighbourPair> pairs;
  ForEachNeighbour(image_id, query_name, database,
                   [&](const auto& other, const auto& matches, const auto& other_points) {
                     auto pair = MakeNeighbourPair(image, points, other, matches, other_points);
                     if (pair) pairs.push_back(*std::move(pair));
                   });
  return pairs;
}

std::vector<NeighbourPair> DatabaseNeighbours::MatchNow(const ModelImage& image, const DatabaseReader& database,
                                                        const MatchFunction& match_now, uint32_t image_id) const {
  const std::vector<Eigen::Vector2d> points = database.ReadKeypoints(image_id);
  std::vector<NeighbourPair> pairs;
  for (const ImagePair& matched : match_now(image, kMaxNumNeighbours)) {
    const ModelImage* other = FindByName(selection_.DatabaseModel().images, matched.other_name);
    auto pair = MakeNeighbourPair(image, points, *other, matched.geometry->inlier_matches, matched.other_keypoints);
    if (pair) pairs.push_back(*std::move(pair));
  }
  return pairs;
}

std::vector<float> DatabaseNeighbours::Triangulate(const ModelImage& image, uint32_t image_id,
                                                   const std::string& query_name,
                                                   const DatabaseReader& database) const {
  const Model& model = selection_.DatabaseModel();
  const PosedCamera camera(model, image);
  const std::vector<Eigen::Vector2d> points = database.ReadKeypoints(image_id);
  std::vector<DepthAndAngle> best(points.size());
  ForEachNeighbour(
      image_id, query_name, database, [&](const auto& other, const auto& matches, const auto& other_points) {
        const PosedCamera other_camera(model, other);
        for (const Match& match : matches) {
          if (match.query_point >= points.size() || match.other_point >= other_points.size()) continue;
          const auto found =
              TriangulateDepth(camera, points[match.query_point], other_camera, other_points[match.other_point]);
          if (found && found->angle_rad > best[match.query_point].angle_rad) best[match.query_point] = *found;
        }
      });
  std::vector<float> depths;
  for (const DepthAndAngle& point : best) depths.push_back(static_cast<float>(point.depth));
  return depths;
}

template <typename Value, typename Find>
std::vector<Value> DatabaseNeighbours::FindOnce(const std::string& image_name, const std::string& query_name,
                                                const DatabaseReader& database, LruCache<std::vector<Value>>* cache,
                                                Find find) const {
  const DatabaseImage* stored = selection_.FindInDatabase(image_name);
  const ModelImage* image = stored == nullptr ? nullptr : selection_.FindPosedImage(stored->image_id, query_name);
  if (image == nullptr) return {};
  const auto find_now = [&] { return (this->*find)(*image, stored->image_id, query_name, database); };
  try {
    // A query that is itself a posed image takes no part, so that what is found is its own.
    return selection_.HasPosedQueries() ? find_now() : *cache->Get(stored->image_id, find_now);
  } catch (const DamagedRecordError&) {
    return {};  // the list of the image's pairs is damaged
  }
}

void DatabaseNeighbours::AddTo(const DatabaseReader& database, const MatchFunction& match_now,
                               LoadedGroup* loaded) const {
  std::vector<std::set<std::string>> names(loaded->group.frame_names.size());
  for (const QueryImage& query : loaded->group.images) {
    for (const ImagePair& pair : query.problem.pairs) {
      if (NumMatches(pair) >= kMinNumInliers) names[query.frame].insert(pair.other_name);
    }
  }
  for (QueryImage& query : loaded->group.images) {
    const bool has_enough_images = names[query.frame].size() >= kEnoughImages;
    if (names[query.frame].empty()) continue;
    if (has_enough_images && NumCommonPoints(query.problem.pairs) >= kEnoughPoints) continue;
    QueryRecord& record = loaded->records[&query - loaded->group.images.data()];
    const bool is_photo = record.matcher.has_value();
    const StageTimer timer("database_pairs", &record.seconds);
    for (ImagePair& pair : query.problem.pairs) {
      if (NumMatches(pair) < kMinNumInliers) continue;
      pair.neighbours =
          FindOnce(pair.other_name, query.problem.query_name, database, &pairs_, &DatabaseNeighbours::Read);
      // Matching takes long.
      if (!pair.neighbours.empty() || !is_photo || !match_now || has_enough_images) continue;
      const ModelImage* image = FindByName(selection_.DatabaseModel().images, pair.other_name);
      const DatabaseImage* stored = selection_.FindInDatabase(pair.other_name);
      pair.neighbours = *matched_pairs_.Get(stored->image_id,
                                            [&] { return MatchNow(*image, database, match_now, stored->image_id); });
    }
  }
}

std::vector<float> DatabaseNeighbours::PointDepths(const std::string& image_name, const std::string& query_name,
                                                   const DatabaseReader& database) const {
  return FindOnce(image_name, query_name, database, &depths_, &DatabaseNeighbours::Triangulate);
}

}  // namespace lazyloc
