#include <algorithm>
#include <cmath>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/structure/point_finder.h"
#include "colmap_lazyloc/structure/ray_intersection.h"

namespace lazyloc {
namespace {

// Finds the point nearest to all rays. If not all observations agree with it, takes those that agree with the pair of
// observations that most others agree with. Works in buffers that it keeps.
class RayPointFinder : public PointFinder {
 public:
  RayPointFinder(const TrackEvaluator& evaluator, const TrackTriangulationOptions& options)
      : evaluator_(evaluator),
        options_(options),
        max_cos_angle_(std::cos(DegToRad(options.min_triangulation_angle_deg))) {}

  std::optional<Eigen::Vector3d> FindPoint(const std::vector<TrackObservation>& observations,
                                           const ObservationIndices& used) override {
    RayIntersection intersection;
    for (const size_t i : used) {
      intersection.Add(evaluator_.CamInWorldOf(observations[i]), evaluator_.RayInWorld(observations[i]));
    }
    return intersection.Point();
  }

  std::optional<Eigen::Vector3d> FindConsensus(const std::vector<TrackObservation>& observations,
                                               ObservationIndices* used) override {
    const std::optional<Eigen::Vector3d> point = FindPoint(observations, *used);
    if (!point || AllAgree(observations, *used, *point)) return point;
    if (used->size() == 2) return std::nullopt;  // their only pair has just failed
    used->swap(candidates_);
    FindBestAgreeing(observations, used);
    if (used->size() < 2) return std::nullopt;
    const std::optional<Eigen::Vector3d> consensus = FindPoint(observations, *used);
    return consensus && AllAgree(observations, *used, *consensus) ? consensus : std::nullopt;
  }

 private:
  bool Agrees(const TrackObservation& element, const Eigen::Vector3d& point) const {
    return evaluator_.Fits(element, point, kMaxDatabaseErrorSigma);
  }

  bool AllAgree(const std::vector<TrackObservation>& observations, const ObservationIndices& used,
                const Eigen::Vector3d& point) const {
    return std::all_of(used.begin(), used.end(), [&](size_t i) { return Agrees(observations[i], point); });
  }

  // Sets `best` to the candidates that agree with the pair of candidates that most others agree with.
  void FindBestAgreeing(const std::vector<TrackObservation>& observations, ObservationIndices* best) {
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

  const TrackEvaluator& evaluator_;
  const TrackTriangulationOptions& options_;
  const double max_cos_angle_;
  ObservationIndices candidates_, agreeing_, pair_;
};

}  // namespace

std::unique_ptr<PointFinder> MakeRayPointFinder(const TrackEvaluator& evaluator,
                                                const TrackTriangulationOptions& options) {
  return std::make_unique<RayPointFinder>(evaluator, options);
}

}  // namespace lazyloc
