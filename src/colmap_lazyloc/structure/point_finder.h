#pragma once

#include <optional>
#include <vector>

#include "colmap_lazyloc/structure/track_evaluator.h"

namespace lazyloc {

// Maximum distance of a point from a keypoint in a database image, in standard deviations of the image's noise: true
// matches exceed it once in 3000.
inline constexpr double kMaxDatabaseErrorSigma = 4;

// Finds the points of tracks, one track after the other, as the points nearest to all rays. Works in buffers that it
// keeps.
class PointFinder {
 public:
  // max_cos_angle: cosine of the minimum angle between two rays that tell a point. The evaluator must outlive this.
  PointFinder(const TrackEvaluator& evaluator, double max_cos_angle)
      : evaluator_(evaluator), max_cos_angle_(max_cos_angle) {}

  // Returns the point nearest to all used observations; nullopt if they have none.
  std::optional<Eigen::Vector3d> FindPoint(const std::vector<TrackObservation>& observations,
                                           const ObservationIndices& used) const;

  // Returns a point that the used observations fit within kMaxDatabaseErrorSigma, after removing from `used` those
  // that disagree: all but those that agree with the pair of observations that most others agree with. Returns nullopt
  // if fewer than two agree.
  std::optional<Eigen::Vector3d> FindConsensus(const std::vector<TrackObservation>& observations,
                                               ObservationIndices* used);

 private:
  bool Agrees(const TrackObservation& element, const Eigen::Vector3d& point) const;
  bool AllAgree(const std::vector<TrackObservation>& observations, const ObservationIndices& used,
                const Eigen::Vector3d& point) const;
  // Sets `best` to the candidates that agree with the pair of candidates that most others agree with.
  void FindBestAgreeing(const std::vector<TrackObservation>& observations, ObservationIndices* best);

  const TrackEvaluator& evaluator_;
  const double max_cos_angle_;
  ObservationIndices candidates_, agreeing_, pair_;
};

}  // namespace lazyloc
