#include "colmap_lazyloc/structure/track_triangulation.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/options_check.h"
#include "colmap_lazyloc/structure/ray_intersection.h"

namespace lazyloc {

bool TrackTriangulationOptions::Check(std::string* error) const {
  OPTION_GT(max_query_error_sigma, 0);
  OPTION_GE(min_triangulation_angle_deg, 0);
  OPTION_GE(single_image_noise_ratio, 1);
  return true;
}

namespace {

// Maximum distance of a point from a keypoint in a database image, in standard deviations of the image's noise: true
// matches exceed it once in 3000.
constexpr double kMaxDatabaseErrorSigma = 4;

// Indices of a track's observations, ascending.
using ObservationIndices = std::vector<size_t>;

// Checks points of tracks against their images. Holds the poses as matrices, because the inner loops are faster with
// them.
class TrackEvaluator {
 public:
  explicit TrackEvaluator(const PosedImages& posed) : posed_(posed) {
    for (const Rigid3d& cam_from_world : CamsFromWorld(posed)) {
      cams_from_world_.emplace_back();
      cams_from_world_.back() << cam_from_world.rotation.toRotationMatrix(), cam_from_world.translation;
      cams_in_world_.push_back(CamInWorld(cam_from_world));
    }
  }

  bool IsDatabase(const TrackObservation& element) const { return posed_.IsDatabase(element.image); }
  const Image& ImageOf(const TrackObservation& element) const { return posed_.images[element.image]; }
  const Eigen::Vector3d& CamInWorldOf(const TrackObservation& element) const { return cams_in_world_[element.image]; }
  Eigen::Vector3d RayInWorld(const TrackObservation& element) const {
    return cams_from_world_[element.image].leftCols<3>().transpose().lazyProduct(element.observation.ray_in_cam);
  }

  // Returns true if a point lies in front of an image and within max_error_sigma standard deviations of its keypoint.
  bool Fits(const TrackObservation& element, const Eigen::Vector3d& point_in_world, double max_error_sigma) const {
    return IsNear(element, point_in_world, max_error_sigma * ImageOf(element).noise_px);
  }

  // Does the same with a bound in pixels.
  bool IsNear(const TrackObservation& element, const Eigen::Vector3d& point_in_world, double max_error_px) const {
    const Eigen::Matrix<double, 3, 4>& cam_from_world = cams_from_world_[element.image];
    const Eigen::Vector3d point_in_cam = cam_from_world.leftCols<3>() * point_in_world + cam_from_world.col(3);
    return IsInFront(element.observation, point_in_cam) &&
           ReprojectionError(element.observation, point_in_cam).squaredNorm() <= max_error_px * max_error_px;
  }

  // Returns true if two of the rays to a point meet at an angle whose cosine is less than max_cos_angle.
  bool IsSeenUnderAngle(const std::vector<TrackObservation>& observations, const ObservationIndices& indices,
                        const Eigen::Vector3d& point, double max_cos_angle) const {
    for (size_t a = 0; a < indices.size(); ++a) {
      const Eigen::Vector3d ray_a = (point - CamInWorldOf(observations[indices[a]])).normalized();
      for (size_t b = 0; b < a; ++b) {
        const Eigen::Vector3d ray_b = (point - CamInWorldOf(observations[indices[b]])).normalized();
        if (ray_a.dot(ray_b) < max_cos_angle) return true;
      }
    }
    return false;
  }

 private:
  const PosedImages& posed_;
  std::vector<Eigen::Matrix<double, 3, 4>> cams_from_world_;
  std::vector<Eigen::Vector3d> cams_in_world_;
};

// Triangulates one track after the other. Works in buffers that it keeps.
class TrackTriangulator {
 public:
  TrackTriangulator(const PosedImages& posed, const TrackTriangulationOptions& options)
      : posed_(posed),
        evaluator_(posed),
        options_(options),
        max_cos_angle_(std::cos(DegToRad(options.min_triangulation_angle_deg))) {}

  // Sets the track's point from its database observations and removes those that disagree with it. Returns false if the
  // track has no such point.
  bool FromDatabase(Track* track) {
    std::vector<TrackObservation>& observations = track->observations;
    used_.clear();
    for (size_t i = 0; i < observations.size(); ++i) {
      if (evaluator_.IsDatabase(observations[i])) used_.push_back(i);
    }
    const size_t num_queries = observations.size() - used_.size();  // they come first
    if (used_.size() < 2) return false;
    const std::optional<Eigen::Vector3d> point = FindConsensus(observations);
    if (!point || !evaluator_.IsSeenUnderAngle(observations, used_, *point, max_cos_angle_)) return false;
    track->point_in_world = *point;
    size_t num_kept = num_queries;
    for (const size_t i : used_) observations[num_kept++] = observations[i];  // they ascend
    observations.resize(num_kept);
    return true;
  }

  // Sets the track's point and noise from all its observations. Returns false if it has no such point.
  bool WithQuery(Track* track) {
    const std::vector<TrackObservation>& observations = track->observations;
    if (!NeedsQueryPoses(observations)) return FromDepth(track);
    used_.resize(observations.size());
    std::iota(used_.begin(), used_.end(), 0);
    track->noise_ratio = options_.single_image_noise_ratio;
    const std::optional<Eigen::Vector3d> point = FindPoint(observations, used_);
    if (!point || !evaluator_.IsSeenUnderAngle(observations, used_, *point, max_cos_angle_)) return FromDepth(track);
    track->point_in_world = *point;
    return FitsAll(*track);
  }

  // Sets the track's point from the depth map of a database image, if its rays meet at too small an angle. Returns
  // false without a depth.
  bool FromDepth(Track* track) {
    for (const TrackObservation& element : track->observations) {
      const std::optional<Eigen::Vector3d> point =
          PointByDepth(evaluator_.ImageOf(element), CamFromWorld(posed_, element.image), element);
      if (!point) continue;
      track->noise_ratio = options_.single_image_noise_ratio;
      track->point_in_world = *point;
      return FitsAll(*track);
    }
    return false;
  }

 private:
  // Returns the point nearest to the rays of all used observations; nullopt if they have none.
  std::optional<Eigen::Vector3d> FindPoint(const std::vector<TrackObservation>& observations,
                                           const ObservationIndices& used) const {
    RayIntersection intersection;
    for (const size_t i : used) {
      intersection.Add(evaluator_.CamInWorldOf(observations[i]), evaluator_.RayInWorld(observations[i]));
    }
    return intersection.Point();
  }

  // Returns a point that the used observations fit within kMaxDatabaseErrorSigma, after removing from used_ those that
  // disagree: all but those that agree with the pair of observations that most others agree with. Returns nullopt if
  // fewer than two agree.
  std::optional<Eigen::Vector3d> FindConsensus(const std::vector<TrackObservation>& observations) {
    const std::optional<Eigen::Vector3d> point = FindPoint(observations, used_);
    if (!point || AllAgree(observations, *point)) return point;
    if (used_.size() == 2) return std::nullopt;  // their only pair has just failed
    used_.swap(candidates_);
    FindBestAgreeing(observations);
    if (used_.size() < 2) return std::nullopt;
    const std::optional<Eigen::Vector3d> consensus = FindPoint(observations, used_);
    return consensus && AllAgree(observations, *consensus) ? consensus : std::nullopt;
  }

  bool Agrees(const TrackObservation& element, const Eigen::Vector3d& point) const {
    return evaluator_.Fits(element, point, kMaxDatabaseErrorSigma);
  }

  bool AllAgree(const std::vector<TrackObservation>& observations, const Eigen::Vector3d& point) const {
    return std::all_of(used_.begin(), used_.end(), [&](size_t i) { return Agrees(observations[i], point); });
  }

  // Sets used_ to the candidates that agree with the pair of candidates that most others agree with.
  void FindBestAgreeing(const std::vector<TrackObservation>& observations) {
    used_.clear();
    for (size_t a = 0; a < candidates_.size(); ++a) {
      for (size_t b = 0; b < a && used_.size() < candidates_.size(); ++b) {
        pair_ = {candidates_[a], candidates_[b]};
        const std::optional<Eigen::Vector3d> point = FindPoint(observations, pair_);
        if (!point || !evaluator_.IsSeenUnderAngle(observations, pair_, *point, max_cos_angle_)) continue;
        agreeing_.clear();
        for (const size_t i : candidates_) {
          if (Agrees(observations[i], *point)) agreeing_.push_back(i);
        }
        if (agreeing_.size() > used_.size()) used_.swap(agreeing_);
      }
    }
  }

  bool FitsAll(const Track& track) const {
    return std::all_of(track.observations.begin(), track.observations.end(), [&](const TrackObservation& element) {
      return evaluator_.Fits(element, track.point_in_world, options_.max_query_error_sigma);
    });
  }

  // Returns true if the track constrains a query's pose, but its database observations alone have no point: there is
  // one, or they are from nearly the same direction.
  bool NeedsQueryPoses(const std::vector<TrackObservation>& observations) const {
    std::optional<Eigen::Vector3d> first_ray;
    for (const TrackObservation& element : observations) {
      if (!evaluator_.IsDatabase(element)) continue;
      const Eigen::Vector3d ray = evaluator_.RayInWorld(element);
      if (first_ray && ray.dot(*first_ray) < max_cos_angle_ * ray.norm() * first_ray->norm()) return false;
      if (!first_ray) first_ray = ray;
    }
    const int first_frame = evaluator_.ImageOf(observations.front()).frame;
    return std::any_of(observations.begin(), observations.end(), [&](const TrackObservation& element) {
      return evaluator_.ImageOf(element).frame != first_frame;
    });
  }

  const PosedImages& posed_;
  const TrackEvaluator evaluator_;
  const TrackTriangulationOptions& options_;
  const double max_cos_angle_;
  ObservationIndices used_, candidates_, agreeing_, pair_;
};

enum class CheckedImages { QUERIES, ALL };

// Returns the root mean square of the noise of a track's database images; 0 if there are none.
double DatabaseNoisePx(const TrackEvaluator& evaluator, const std::vector<TrackObservation>& observations) {
  double sum = 0;
  int num_images = 0;
  for (const TrackObservation& element : observations) {
    if (!evaluator.IsDatabase(element)) continue;
    const double noise_px = evaluator.ImageOf(element).noise_px;
    sum += noise_px * noise_px;
    ++num_images;
  }
  return num_images > 0 ? std::sqrt(sum / num_images) : 0;
}

// Removes a track's observations that its point does not fit in the checked images. Returns false if the track is then
// of no use: a database image contradicts it, or no query observes it.
bool RemoveMisfits(const TrackEvaluator& evaluator, double max_error_sigma, CheckedImages checked, Track* track) {
  std::vector<TrackObservation>& observations = track->observations;
  // A point from database images whose poses are not yet corrected is no more certain than these.
  const double min_noise_px = checked == CheckedImages::QUERIES ? DatabaseNoisePx(evaluator, observations) : 0;
  size_t num_kept = 0;
  for (size_t i = 0; i < observations.size(); ++i) {
    const bool is_database = evaluator.IsDatabase(observations[i]);
    const bool is_checked = checked == CheckedImages::ALL || !is_database;
    const double noise_px = std::max(evaluator.ImageOf(observations[i]).noise_px, min_noise_px);
    if (!is_checked || evaluator.IsNear(observations[i], track->point_in_world, max_error_sigma * noise_px)) {
      if (num_kept < i) observations[num_kept] = observations[i];
      ++num_kept;
    } else if (is_database) {
      return false;
    }
  }
  observations.resize(num_kept);
  return num_kept >= 2 && !evaluator.IsDatabase(observations.front());
}

// Keeps the tracks for which keep(track) is true, in their order.
template <typename Keep>
std::vector<Track> KeepIf(std::vector<Track> tracks, const Keep& keep) {
  size_t num_kept = 0;
  for (Track& track : tracks) {
    if (keep(&track)) std::swap(tracks[num_kept++], track);
  }
  tracks.resize(num_kept);
  return tracks;
}

}  // namespace

SplitTracks TriangulateFromDatabase(const PosedImages& posed, std::vector<Track> tracks,
                                    const TrackTriangulationOptions& options) {
  TrackTriangulator triangulator(posed, options);
  SplitTracks split;
  split.from_database = KeepIf(std::move(tracks), [&](Track* track) {
    const bool has_point = triangulator.FromDatabase(track);
    if (!has_point) split.rest.push_back(std::move(*track));
    return has_point;
  });
  return split;
}

std::vector<Track> TriangulateWithQuery(const PosedImages& posed, std::vector<Track> tracks,
                                        const TrackTriangulationOptions& options) {
  TrackTriangulator triangulator(posed, options);
  return KeepIf(std::move(tracks), [&](Track* track) { return triangulator.WithQuery(track); });
}

std::vector<Track> RemoveQueryOutliers(const PosedImages& posed, std::vector<Track> tracks, double max_error_sigma) {
  const TrackEvaluator evaluator(posed);
  return KeepIf(std::move(tracks),
                [&](Track* track) { return RemoveMisfits(evaluator, max_error_sigma, CheckedImages::QUERIES, track); });
}

std::vector<Track> RemoveOutliers(const PosedImages& posed, std::vector<Track> tracks, double max_error_sigma) {
  const TrackEvaluator evaluator(posed);
  return KeepIf(std::move(tracks),
                [&](Track* track) { return RemoveMisfits(evaluator, max_error_sigma, CheckedImages::ALL, track); });
}

}  // namespace lazyloc
