#include "colmap_lazyloc/structure/track_triangulation.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include <Eigen/Geometry>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/options_check.h"
#include "colmap_lazyloc/structure/ray_intersection.h"

namespace lazyloc {
namespace {

using Matrix3x4d = Eigen::Matrix<double, 3, 4>;

Matrix3x4d MatrixOf(const Rigid3d& cam_from_world) {
  Matrix3x4d matrix;
  matrix << cam_from_world.rotation.toRotationMatrix(), cam_from_world.translation;
  return matrix;
}

// Holds the images' poses as matrices, because the inner loops are faster with them.
class TrackEvaluator {
 public:
  explicit TrackEvaluator(const PosedImages& posed) : posed_(posed) {
    for (const Rigid3d& cam_from_world : CamsFromWorld(posed)) cams_from_world_.push_back(MatrixOf(cam_from_world));
  }

  // Returns true if a point lies in front of an image and within max_error_sigma standard deviations of its keypoint.
  bool Fits(const TrackObservation& element, const Eigen::Vector3d& point_in_world, double max_error_sigma) const {
    const Matrix3x4d& cam_from_world = cams_from_world_[element.image];
    const Eigen::Vector3d point_in_cam = cam_from_world.leftCols<3>() * point_in_world + cam_from_world.col(3);
    const double max_error_px = max_error_sigma * posed_.images[element.image].noise_px;
    return IsInFront(element.observation, point_in_cam) &&
           ReprojectionError(element.observation, point_in_cam).squaredNorm() <= max_error_px * max_error_px;
  }

  bool IsDatabase(const TrackObservation& element) const { return posed_.IsDatabase(element.image); }

 protected:
  const PosedImages& posed_;
  std::vector<Matrix3x4d> cams_from_world_;
};

// Triangulates one track after the other. Works on indices of a track's observations, in buffers that it keeps.
class TrackTriangulator : public TrackEvaluator {
 public:
  TrackTriangulator(const PosedImages& posed, const TrackTriangulationOptions& options)
      : TrackEvaluator(posed),
        options_(options),
        max_cos_angle_(std::cos(DegToRad(options.min_triangulation_angle_deg))) {
    for (const Rigid3d& cam_from_world : CamsFromWorld(posed)) cams_in_world_.push_back(CamInWorld(cam_from_world));
  }

  // Sets the track's point from its database observations and removes those that disagree with it: none if all agree,
  // else all but those that agree with the best pair of them. Returns false if the track has no such point.
  bool FromDatabase(Track* track) {
    std::vector<TrackObservation>& observations = track->observations;
    used_.clear();
    for (size_t i = 0; i < observations.size(); ++i) {
      if (IsDatabase(observations[i])) used_.push_back(i);
    }
    const size_t num_queries = observations.size() - used_.size();  // they come first
    Eigen::Vector3d point;
    if (used_.size() < 2 || !Intersect(observations, used_, &point)) return false;
    if (!AllAgree(observations, point)) {
      if (used_.size() == 2) return false;  // their only pair is what has just failed
      used_.swap(candidates_);
      FindBestAgreeing(observations);
      if (used_.size() < 2 || !Intersect(observations, used_, &point) || !AllAgree(observations, point)) return false;
    }
    if (!SeenUnderAngle(observations, used_, point)) return false;
    track->point_in_world = point;
    size_t num_kept = num_queries;
    for (const size_t i : used_) observations[num_kept++] = observations[i];  // they ascend
    observations.resize(num_kept);
    return true;
  }

  // Sets the track's point and noise from all its observations. Returns false if it has no such point.
  bool WithQuery(Track* track) {
    const std::vector<TrackObservation>& observations = track->observations;
    if (!NeedsQueryPoses(observations)) return false;
    used_.resize(observations.size());
    std::iota(used_.begin(), used_.end(), 0);
    track->noise_ratio = options_.single_image_noise_ratio;
    if (!Intersect(observations, used_, &track->point_in_world)) return false;
    if (!SeenUnderAngle(observations, used_, track->point_in_world)) return false;
    return std::all_of(observations.begin(), observations.end(), [&](const TrackObservation& element) {
      return Fits(element, track->point_in_world, options_.max_query_error_sigma);
    });
  }

 private:
  using Indices = std::vector<size_t>;

  // Returns true if the track constrains a query's pose, but its database observations alone have no point.
  bool NeedsQueryPoses(const std::vector<TrackObservation>& observations) const {
    int num_database = 0, num_frames = 0, last_frame = -1;  // images of a frame stand together
    for (const TrackObservation& element : observations) {
      if (IsDatabase(element)) {
        ++num_database;
      } else if (posed_.images[element.image].frame != last_frame) {
        ++num_frames;
        last_frame = posed_.images[element.image].frame;
      }
    }
    return num_database <= 1 && num_database + num_frames >= 2;
  }

  bool Intersect(const std::vector<TrackObservation>& observations, const Indices& indices,
                 Eigen::Vector3d* point) const {
    RayIntersection intersection;
    for (const size_t i : indices) {
      const int image = observations[i].image;
      intersection.Add(cams_in_world_[image], cams_from_world_[image].leftCols<3>().transpose().lazyProduct(
                                                 observations[i].observation.ray_in_cam));
    }
    const std::optional<Eigen::Vector3d> intersected = intersection.Point();
    if (intersected) *point = *intersected;
    return intersected.has_value();
  }

  bool SeenUnderAngle(const std::vector<TrackObservation>& observations, const Indices& indices,
                      const Eigen::Vector3d& point) const {
    for (size_t a = 0; a < indices.size(); ++a) {
      const Eigen::Vector3d ray_a = (point - cams_in_world_[observations[indices[a]].image]).normalized();
      for (size_t b = 0; b < a; ++b) {
        const Eigen::Vector3d ray_b = (point - cams_in_world_[observations[indices[b]].image]).normalized();
        if (ray_a.dot(ray_b) < max_cos_angle_) return true;
      }
    }
    return false;
  }

  bool Agrees(const TrackObservation& element, const Eigen::Vector3d& point) const {
    return Fits(element, point, options_.max_database_error_sigma);
  }

  bool AllAgree(const std::vector<TrackObservation>& observations, const Eigen::Vector3d& point) const {
    return std::all_of(used_.begin(), used_.end(), [&](size_t i) { return Agrees(observations[i], point); });
  }

  // Sets used_ to the candidates that agree with the pair of candidates that most others agree with.
  void FindBestAgreeing(const std::vector<TrackObservation>& observations) {
    used_.clear();
    pair_.resize(2);
    for (size_t a = 0; a < candidates_.size(); ++a) {
      for (size_t b = 0; b < a && used_.size() < candidates_.size(); ++b) {
        Eigen::Vector3d point;
        pair_ = {candidates_[a], candidates_[b]};
        if (!Intersect(observations, pair_, &point) || !SeenUnderAngle(observations, pair_, point)) continue;
        agreeing_.clear();
        for (const size_t i : candidates_) {
          if (Agrees(observations[i], point)) agreeing_.push_back(i);
        }
        if (agreeing_.size() > used_.size()) used_.swap(agreeing_);
      }
    }
  }

  const TrackTriangulationOptions& options_;
  const double max_cos_angle_;
  std::vector<Eigen::Vector3d> cams_in_world_;
  Indices used_, candidates_, agreeing_, pair_;
};

enum class CheckedImages { QUERIES, ALL };

// Removes a track's observations that its point does not fit in the checked images. Returns false if the track is then
// of no use: a database image contradicts it, or no query observes it.
bool RemoveMisfits(const TrackEvaluator& evaluator, double max_error_sigma, CheckedImages checked, Track* track) {
  std::vector<TrackObservation>& observations = track->observations;
  size_t num_kept = 0;
  for (size_t i = 0; i < observations.size(); ++i) {
    const bool is_database = evaluator.IsDatabase(observations[i]);
    const bool is_checked = checked == CheckedImages::ALL || !is_database;
    if (!is_checked || evaluator.Fits(observations[i], track->point_in_world, max_error_sigma)) {
      if (num_kept < i) observations[num_kept] = observations[i];
      ++num_kept;
    } else if (is_database) {
      return false;
    }
  }
  observations.resize(num_kept);
  return num_kept >= 2 && !evaluator.IsDatabase(observations.front());
}

std::vector<Track> TracksThatFit(const PosedImages& posed, std::vector<Track> tracks, double max_error_sigma,
                                 CheckedImages checked) {
  const TrackEvaluator evaluator(posed);
  size_t num_kept = 0;
  for (Track& track : tracks) {
    if (RemoveMisfits(evaluator, max_error_sigma, checked, &track)) std::swap(tracks[num_kept++], track);
  }
  tracks.resize(num_kept);
  return tracks;
}

}  // namespace

bool TrackTriangulationOptions::Check(std::string* error) const {
  OPTION_GT(max_database_error_sigma, 0);
  OPTION_GT(max_query_error_sigma, 0);
  OPTION_GE(min_triangulation_angle_deg, 0);
  OPTION_GT(single_image_noise_ratio, 0);
  return true;
}

SplitTracks TriangulateFromDatabase(const PosedImages& posed, std::vector<Track> tracks,
                                    const TrackTriangulationOptions& options) {
  TrackTriangulator triangulator(posed, options);
  SplitTracks split;
  size_t num_kept = 0;
  for (Track& track : tracks) {
    if (triangulator.FromDatabase(&track)) {
      std::swap(tracks[num_kept++], track);
    } else {
      split.rest.push_back(std::move(track));
    }
  }
  tracks.resize(num_kept);
  split.from_database = std::move(tracks);
  return split;
}

std::vector<Track> TriangulateWithQuery(const PosedImages& posed, std::vector<Track> tracks,
                                        const TrackTriangulationOptions& options) {
  TrackTriangulator triangulator(posed, options);
  size_t num_kept = 0;
  for (Track& track : tracks) {
    if (triangulator.WithQuery(&track)) std::swap(tracks[num_kept++], track);
  }
  tracks.resize(num_kept);
  return tracks;
}

std::vector<Track> RemoveQueryOutliers(const PosedImages& posed, std::vector<Track> tracks, double max_error_sigma) {
  return TracksThatFit(posed, std::move(tracks), max_error_sigma, CheckedImages::QUERIES);
}

std::vector<Track> RemoveOutliers(const PosedImages& posed, std::vector<Track> tracks, double max_error_sigma) {
  return TracksThatFit(posed, std::move(tracks), max_error_sigma, CheckedImages::ALL);
}

}  // namespace lazyloc
