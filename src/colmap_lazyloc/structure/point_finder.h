#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "colmap_lazyloc/structure/track_evaluator.h"
#include "colmap_lazyloc/structure/track_triangulation.h"

namespace lazyloc {

// Maximum distance of a point from a keypoint in a database image, in standard deviations of the image's noise: true
// matches exceed it once in 3000.
inline constexpr double kMaxDatabaseErrorSigma = 4;

// Finds the points of tracks, one track after the other.
class PointFinder {
 public:
  virtual ~PointFinder() = default;

  // Returns the point nearest to all used observations; nullopt if they have none.
  virtual std::optional<Eigen::Vector3d> FindPoint(const std::vector<TrackObservation>& observations,
                                                   const ObservationIndices& used) = 0;

  // Returns a point that the used observations fit within kMaxDatabaseErrorSigma, after removing from `used` those
  // that disagree; nullopt if fewer than two agree.
  virtual std::optional<Eigen::Vector3d> FindConsensus(const std::vector<TrackObservation>& observations,
                                                       ObservationIndices* used) = 0;
};

// Make the finders of TriangulationMethod. `evaluator` and `options` must outlive them.
std::unique_ptr<PointFinder> MakeRayPointFinder(const TrackEvaluator& evaluator,
                                                const TrackTriangulationOptions& options);
std::unique_ptr<PointFinder> MakeColmapPointFinder(const TrackEvaluator& evaluator,
                                                   const TrackTriangulationOptions& options);

}  // namespace lazyloc
