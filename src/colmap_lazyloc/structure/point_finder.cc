#include "colmap_lazyloc/structure/point_finder.h"

#include <algorithm>

#include "colmap_lazyloc/structure/ray_intersection.h"

namespace lazyloc {

std::optional<Eigen::Vector3d> PointFinder::FindPoint(const std::vector<TrackObservation>& observations,
                                                      const ObservationIndices& used) const {
  RayIntersection intersection;
  for (const size_t i : used) {
    intersection.Add(evaluator_.CamInWorldOf(observations[i]), evaluator_.RayInWorld(observations[i]));
  }
  return intersection.Point();
}

std::optional<Eigen::Vector3d> PointFinder::FindConsensus(const std::vector<TrackObservation>& observations,
                                                          ObservationIndices* used) {
  const std::optional<Eigen::Vector3d> point = FindPoint(observations, *used);
  if (!point || AllAgree(observations, *used, *point)) return point;
  if (used->size() == 2) return std::nullopt;  // their only pair has just failed
  used->swap(candidates_);
  FindBestAgreeing(observations, used);
  if (used->size() < 2) return std::nullopt;
  const std::optional<Eigen::Vector3d> consensus = FindPoint(observations, *used);
  return consensus && AllAgree(observations, *used, *consensus) ? consensus : std::nullopt;
}

bool PointFinder::Agrees(const TrackObservation& element, const Eigen::Vector3d& point) const {
  return evaluator_.Fits(element, point, kMaxDatabaseErrorSigma);
}

bool PointFinder::AllAgree(const std::vector<TrackObservation>& observations, const ObservationIndices& used,
                           const Eigen::Vector3d& point) const {
  return std::all_of(used.begin(), used.end(), [&](size_t i) { return Agrees(observations[i], point); });
}

void PointFinder::FindBestAgreeing(const std::vector<TrackObservation>& observations, ObservationIndices* best) {
  best->clear();
  pair_.resize(2);
  for (size_t a = 0; a < candidates_.size(); ++a) {
    for (size_t b = 0; b < a && best->size() < candidates_.size(); ++b) {
      pair_ = {candidates_[a], candidates_[b]};
      const std::optional<Eigen::Vector3d> point = FindPoint(observations, pair_);
      if (!point || !evaluator_.IsSeenUnderAngle(observations, pair_, *point, max_cos_angle_)) continue;
      agreeing_.clear();
      for (const size_t i : candidates_) {
        if (Agrees(observations[i], *point)) agreeing_.push_back(i);
      }
      if (agreeing_.size() > best->size()) best->swap(agreeing_);
    }
  }
}

}  // namespace lazyloc
