#include "colmap_lazyloc/structure/track_triangulation.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/structure/point_finder.h"

namespace lazyloc {
namespace {

// Triangulates one track after the other.
class TrackTriangulator {
 public:
  TrackTriangulator(const PosedImages& posed, const TrackTriangulationOptions& options)
      : posed_(posed),
        evaluator_(posed),
        options_(options),
        max_cos_angle_(std::cos(DegToRad(options.min_triangulation_angle_deg))),
        finder_(evaluator_, max_cos_angle_) {}

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
    const std::optional<Eigen::Vector3d> point = finder_.FindConsensus(observations, &used_);
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
    const std::optional<Eigen::Vector3d> point = finder_.FindPoint(observations, used_);
    if (!point || !evaluator_.IsSeenUnderAngle(observations, used_, *point, max_cos_angle_)) return FromDepth(track);
    track->point_in_world = *point;
    return FitsAll(*track);
  }

  // Sets the track's point from the depth map of a database image, if its rays meet at too small an angle. Returns
  // false without a depth.
  bool FromDepth(Track* track) {
    for (const TrackObservation& element : track->observations) {
      const std::optional<Eigen::Vector3d> point =
          PointByDepth(evaluator_.ImageOf(element), evaluator_.CamFromWorldOf(element), element);
      if (!point) continue;
      track->noise_ratio = options_.single_image_noise_ratio;
      track->point_in_world = *point;
      return FitsAll(*track);
    }
    return false;
  }

 private:
  bool FitsAll(const Track& track) const {
    return std::all_of(track.observations.begin(), track.observations.end(), [&](const TrackObservation& element) {
      return evaluator_.Fits(element, track.point_in_world, options_.max_query_error_sigma);
    });
  }

  // Returns true if the track constrains a query's pose, but its database observations alone have no point.
  bool NeedsQueryPoses(const std::vector<TrackObservation>& observations) const {
    if (HasSeveralDatabaseFrames(posed_, observations)) return false;
    const int first_frame = evaluator_.ImageOf(observations.front()).frame;
    return std::any_of(observations.begin(), observations.end(), [&](const TrackObservation& element) {
      return evaluator_.ImageOf(element).frame != first_frame;
    });
  }

  const PosedImages& posed_;
  const TrackEvaluator evaluator_;
  const TrackTriangulationOptions& options_;
  const double max_cos_angle_;
  PointFinder finder_;
  ObservationIndices used_;
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
