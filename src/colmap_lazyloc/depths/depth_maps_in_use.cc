#include "colmap_lazyloc/depths/depth_maps_in_use.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/two_rays.h"

namespace lazyloc {
namespace {

// Minimum sine of the angle between two rays (2 degrees) at which a pair tells how exact a depth is.
constexpr double kMinDepthSine = 0.035;
// Standard deviation of the log of a scale that only the adjusted tracks themselves tell.
constexpr double kFreeScaleStddev = 3;

// Minimum number of depths that tell the length of a pair's baseline.
constexpr size_t kMinNumDepthsOfPair = 8;

// A database image with a map, and the pair that has its depths.
struct MapOfImage {
  int query = -1;
  int image = -1;  // index into PosedImages::images
  const ImagePair* pair = nullptr;
  DepthFit fit;
};

// Adds a sample if the map knows the depth.
void AddSample(const ImagePair& pair, size_t keypoint, double point_depth, std::vector<DepthSample>* samples) {
  const double map_depth = pair.other_depths[keypoint];
  if (!(map_depth > 0 && point_depth > 0)) return;
  const Eigen::Vector2d size(static_cast<double>(pair.other_camera.width),
                             static_cast<double>(pair.other_camera.height));
  samples->push_back({map_depth, point_depth, pair.other_keypoints[keypoint].cwiseQuotient(size)});
}

std::vector<DepthSample> SamplesOfPoints(const ImagePair& pair) {
  std::vector<DepthSample> samples;
  for (size_t i = 0; i < pair.other_point_depths.size(); ++i) AddSample(pair, i, pair.other_point_depths[i], &samples);
  return samples;
}

std::vector<DepthSample> SamplesOfTracks(const MapOfImage& map, const PosedImages& given,
                                         const std::vector<Track>& tracks) {
  std::vector<DepthSample> samples;
  for (const Track& track : tracks) {
    for (const TrackObservation& element : track.observations) {
      if (element.image != map.image) continue;
      const Eigen::Vector3d point = CamFromWorld(given, map.image) * track.point_in_world;
      AddSample(*map.pair, element.keypoint, point.z(), &samples);
    }
  }
  return samples;
}

// Returns depths of the pair's own points in units of its baseline.
std::vector<DepthSample> SamplesOfPair(const PairGeometry& geometry, const ImagePair& pair) {
  std::vector<DepthSample> samples;
  const Eigen::Matrix3d other_from_query = geometry.query_from_other.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3d baseline = CamInWorld(geometry.query_from_other);
  for (const ObservedMatch& match : geometry.inliers) {
    const Eigen::Vector3d& ray = match.other.ray_in_cam;
    const auto nearest = FindNearestPoints(ray, other_from_query * match.query.ray_in_cam, baseline, kMinDepthSine);
    if (!nearest) continue;
    AddSample(pair, match.match.other_point, nearest->distance1 * ray.z(), &samples);
  }
  return samples;
}

std::vector<DepthSample> SamplesOfPair(const MapOfImage& map, const PairRefs& pairs) {
  for (const PairGeometry* pair : pairs) {
    if (pair->query == map.query && pair->other == map.image) return SamplesOfPair(*pair, *map.pair);
  }
  return {};
}

// Returns the query's pose by a pair's relative pose and the distance that the depths tell; nullopt for too few depths.
std::optional<Rigid3d> PoseOfPair(const PairGeometry& pair, const MapOfImage& map, const Layout& layout) {
  std::vector<double> log_lengths;
  for (const DepthSample& sample : SamplesOfPair(pair, *map.pair)) {
    log_lengths.push_back(std::log(sample.map_depth / sample.point_depth) + map.fit.log_scale);
  }
  if (log_lengths.size() < kMinNumDepthsOfPair) return std::nullopt;
  Rigid3d query_from_other = pair.query_from_other;
  query_from_other.translation *= std::exp(Median(std::move(log_lengths)));
  return query_from_other * CamFromWorld(layout.given, pair.other);
}

DepthFit Fit(const MapOfImage& map, const Layout& layout, const PairRefs& pairs, const SplitTracks& tracks,
             const LocalizerOptions& options) {
  DepthFit fit = FitDepthMap(SamplesOfPoints(*map.pair));
  const bool has_points = fit.verdict != DepthVerdict::NO_SCALE;
  if (!has_points) fit = FitDepthMap(SamplesOfTracks(map, layout.given, tracks.from_database));
  const bool has_tracks = !has_points && fit.verdict == DepthVerdict::USED;
  if (options.depth_is_metric) fit = FitMetricDepthMap(fit, FitDepthMap(SamplesOfPair(map, pairs)));
  if (!has_tracks) return fit;
  // Adjustment must not count the tracks twice.
  const double stddev = fit.is_metric ? kMetricScaleStddev : kFreeScaleStddev;
  fit.scale_variance = stddev * stddev;
  return fit;
}

// Returns the maps of the database images that queries have pairs in use with.
std::vector<MapOfImage> MapsOf(const QueryGroup& group, const Layout& layout, const PairRefs& pairs_in_use) {
  std::vector<MapOfImage> maps;
  std::vector<bool> is_wanted(layout.given.images.size(), false);
  for (const PairGeometry* pair : pairs_in_use) is_wanted[pair->other] = true;
  for (int query = 0; query < layout.num_queries; ++query) {
    const std::vector<ImagePair>& pairs = group.images[query].problem.pairs;
    for (size_t i = 0; i < pairs.size(); ++i) {
      const int image = layout.image_of_pair[query][i];
      if (!is_wanted[image] || pairs[i].other_depths.empty()) continue;
      is_wanted[image] = false;
      maps.push_back({query, image, &pairs[i], {}});
    }
  }
  return maps;
}

// Sets the depths of the observations in images whose map is used. map_of_image: index into maps, or -1.
void SetDepths(const std::vector<MapOfImage>& maps, const std::vector<int>& map_of_image, std::vector<Track>* tracks) {
  for (Track& track : *tracks) {
    for (TrackObservation& element : track.observations) {
      if (map_of_image[element.image] < 0) continue;
      const MapOfImage& map = maps[map_of_image[element.image]];
      const double depth = map.pair->other_depths[element.keypoint];
      if (depth > 0) element.depth = static_cast<float>(depth);
    }
  }
}

// Adds the result of a map to all queries that have a pair with its image.
void AddResult(const MapOfImage& map, const Layout& layout, std::vector<DepthResult>* results) {
  DepthMapResult result{map.pair->other_name, map.fit.verdict, map.fit.num_points};
  result.depth_stddev = map.fit.stddev;
  if (map.fit.verdict == DepthVerdict::USED) {
    result.scale = std::exp(map.fit.log_scale);
    result.scale_stddev = std::sqrt(map.fit.scale_variance);
  }
  for (int query = 0; query < layout.num_queries; ++query) {
    const std::vector<int>& images = layout.image_of_pair[query];
    if (std::count(images.begin(), images.end(), map.image) > 0) (*results)[query].maps.push_back(result);
  }
}

}  // namespace

StartInput WithDepthMaps(const QueryGroup& group, const Layout& layout, const PairRefs& pairs,
                         const LocalizerOptions& options, StartInput input) {
  PosedImages& posed = input.posed;
  std::vector<MapOfImage> maps = MapsOf(group, layout, pairs);
  std::vector<int> map_of_image(posed.images.size(), -1);
  input.depths.resize(layout.num_queries);
  input.depth_starts.resize(layout.num_query_frames);
  for (size_t i = 0; i < maps.size(); ++i) {
    maps[i].fit = Fit(maps[i], layout, pairs, input.tracks, options);
    if (maps[i].fit.verdict == DepthVerdict::USED) map_of_image[maps[i].image] = static_cast<int>(i);
    AddResult(maps[i], layout, &input.depths);
  }
  for (std::vector<Track>* tracks :
       {&input.candidates.all, &input.candidates.for_start, &input.tracks.from_database, &input.tracks.rest}) {
    SetDepths(maps, map_of_image, tracks);
  }
  std::vector<int> num_depths(posed.images.size(), 0);
  for (const Track& track : input.candidates.all) {
    for (const TrackObservation& element : track.observations) num_depths[element.image] += element.depth > 0;
  }
  for (size_t image = 0; image < posed.images.size(); ++image) {
    if (map_of_image[image] < 0 || num_depths[image] == 0) continue;
    const DepthFit& fit = maps[map_of_image[image]].fit;
    // Adjustment takes errors as independent. Makes them as large as their mean then is uncertain.
    const double stddev = std::sqrt(fit.pixel_variance + num_depths[image] * fit.common_variance);
    posed.images[image].depth_scale = {fit.log_scale, fit.log_scale, std::sqrt(fit.scale_variance), stddev};
  }
  for (const PairGeometry* pair : pairs) {
    const int map = map_of_image[pair->other];
    if (map < 0) continue;
    const std::optional<Rigid3d> query_from_world = PoseOfPair(*pair, maps[map], layout);
    if (!query_from_world) continue;
    const Rigid3d frame_from_cam = Inverse(layout.given.images[pair->query].cam_from_frame);
    input.depth_starts[layout.FrameOf(pair->query)].push_back(frame_from_cam * *query_from_world);
  }
  return input;
}

}  // namespace lazyloc
