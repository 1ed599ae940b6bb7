#include "colmap_lazyloc/initialization/motion_averaging.h"

#include <algorithm>
#include <string>
#include <utility>

#include "colmap_lazyloc/group/rig_check.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/epipolar_error.h"
#include "colmap_lazyloc/scene/refs.h"
#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

namespace lazyloc {
namespace {

bool IsWithinFrame(const Layout& layout, const PairGeometry& pair) {
  return layout.FrameOf(pair.query) == layout.FrameOf(pair.other);
}

// Returns the pairs whose rotation error is within the bound. Throws for frames whose pairs contradict each other.
PairRefs AgreeingPairs(const Layout& layout, const PairRefs& pairs, const std::vector<double>& rotation_errors_rad,
                       double max_error_deg) {
  std::vector<size_t> num_pairs(layout.num_query_frames, 0), num_agreeing(layout.num_query_frames, 0);
  const auto agrees = [&](size_t i) { return rotation_errors_rad[i] <= DegToRad(max_error_deg); };
  PairRefs agreeing;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const PairGeometry& pair = *pairs[i];
    std::vector<int> frames = {layout.FrameOf(pair.query)};
    if (!layout.IsDatabase(pair.other) && !IsWithinFrame(layout, pair)) frames.push_back(layout.FrameOf(pair.other));
    for (const int frame : frames) {
      ++num_pairs[frame];
      num_agreeing[frame] += agrees(i);
    }
    if (agrees(i)) agreeing.push_back(&pair);
  }
  CheckFrames(layout.num_query_frames, QueryStatus::INCONSISTENT_ROTATIONS, [&](int frame) {
    if (num_agreeing[frame] >= std::min<size_t>(num_pairs[frame], 2)) return Reason();
    return Reason("no two of " + std::to_string(num_pairs[frame]) + " pairs agree on the query's rotation within " +
                  std::to_string(max_error_deg) + " deg");
  });
  return agreeing;
}

// Averages rotations. Nodes are the query frames, by index, then one fixed node for each pair with a database image.
// Sets `posed` and `pairs` of the result.
void AverageRotation(const Layout& layout, const LocalizerOptions& options, RotationAverager average,
                     Averaged* averaged) {
  PosedImages& posed = averaged->posed;
  RotationAveragingProblem problem;
  problem.rotations.assign(layout.num_query_frames, Eigen::Quaterniond::Identity());
  problem.is_fixed.assign(layout.num_query_frames, false);
  std::vector<int> edge_of_pair(averaged->pairs.size(), -1);
  for (size_t i = 0; i < averaged->pairs.size(); ++i) {
    const PairGeometry& pair = *averaged->pairs[i];
    if (IsWithinFrame(layout, pair)) continue;
    edge_of_pair[i] = static_cast<int>(problem.edges.size());
    const Eigen::Quaterniond& query_from_frame = posed.images[pair.query].cam_from_frame.rotation;
    RotationEdge edge{-1, layout.FrameOf(pair.query), query_from_frame.conjugate() * pair.query_from_other.rotation,
                      static_cast<double>(pair.num_inliers)};
    if (layout.IsDatabase(pair.other)) {
      edge.node1 = static_cast<int>(problem.rotations.size());
      problem.rotations.push_back(CamFromWorld(posed, pair.other).rotation);
      problem.is_fixed.push_back(true);
    } else {
      edge.node1 = layout.FrameOf(pair.other);
      edge.node2_from_node1 = edge.node2_from_node1 * posed.images[pair.other].cam_from_frame.rotation;
    }
    problem.edges.push_back(edge);
  }
  const RotationAveragingResult result = AverageRotations(problem, average);
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    posed.frames[frame].frame_from_world.rotation = result.rotations[frame];
  }
  CheckFrames(layout.num_query_frames, QueryStatus::TOO_FEW_INLIERS, [&](int frame) {
    if (result.is_known[frame]) return Reason();
    return Reason("no pair links the query to the database, by other queries either");
  });
  std::vector<double> errors_rad(averaged->pairs.size(), 0);
  for (size_t i = 0; i < errors_rad.size(); ++i) {
    if (edge_of_pair[i] >= 0) errors_rad[i] = result.edge_errors_rad[edge_of_pair[i]];
  }
  const double max_error_deg = kMaxRotationErrorDeg + 3 * std::max(0.0, options.database_pose_stddev_deg);
  CheckRigRotations(layout, averaged->pairs, errors_rad, max_error_deg);
  averaged->pairs = AgreeingPairs(layout, averaged->pairs, errors_rad, max_error_deg);
}

// Estimates each pair's direction of translation again, now that all rotations are known.
std::vector<RelativeDirection> EstimateDirections(const Layout& layout, const Averaged& averaged) {
  std::vector<RelativeDirection> directions(averaged.pairs.size());
  for (size_t k = 0; k < directions.size(); ++k) {
    const PairGeometry& pair = *averaged.pairs[k];
    if (IsWithinFrame(layout, pair)) continue;
    const auto world_from = [&](int image) {
      return CamFromWorld(averaged.posed, image).rotation.conjugate().toRotationMatrix();
    };
    const Eigen::Matrix3d world_from_query = world_from(pair.query), world_from_other = world_from(pair.other);
    std::vector<RayMatch> matches;
    matches.reserve(pair.inliers.size());
    for (const ObservedMatch& inlier : pair.inliers) {
      matches.push_back(MakeRayMatch(world_from_other, inlier.other, world_from_query, inlier.query));
    }
    directions[k] = EstimateRelativeDirection(matches);
  }
  return directions;
}

// Returns the vector from the origin of an image's frame to the image's projection centre.
Eigen::Vector3d OffsetInWorld(const PosedImages& posed, int image) {
  return posed.FrameOf(image).frame_from_world.rotation.conjugate() * CamInWorld(posed.images[image].cam_from_frame);
}

// Averages translations, with nodes as for rotations. Sets `posed` of the result.
void AverageTranslation(const Layout& layout, TranslationAverager average, Averaged* averaged) {
  PosedImages& posed = averaged->posed;
  TranslationAveragingProblem problem;
  problem.cams_in_world.assign(layout.num_query_frames, Eigen::Vector3d::Zero());
  problem.is_fixed.assign(layout.num_query_frames, false);
  std::vector<bool> has_edge(layout.num_query_frames, false);
  for (size_t k = 0; k < averaged->pairs.size(); ++k) {
    const PairGeometry& pair = *averaged->pairs[k];
    const RelativeDirection& direction = averaged->directions[k];
    // A direction with a standard deviation above half a radian means that the pair has no usable baseline.
    if (direction.dir_1to2_in_world.isZero() || direction.stddev_rad > 0.5) continue;
    DirectionEdge edge{-1, layout.FrameOf(pair.query), direction.dir_1to2_in_world, direction.stddev_rad,
                       OffsetInWorld(posed, pair.query)};
    has_edge[edge.node2] = true;
    if (layout.IsDatabase(pair.other)) {
      edge.node1 = static_cast<int>(problem.cams_in_world.size());
      problem.cams_in_world.push_back(CamInWorld(CamFromWorld(posed, pair.other)));
      problem.is_fixed.push_back(true);
    } else {
      edge.node1 = layout.FrameOf(pair.other);
      edge.offset_in_world -= OffsetInWorld(posed, pair.other);
      has_edge[edge.node1] = true;
    }
    problem.edges.push_back(edge);
  }
  CheckBaselines(layout, *averaged, has_edge);
  if (!layout.has_depths) CheckPlaces(layout, *averaged);
  const TranslationAveragingResult result = AverageTranslations(problem, average);
  CheckBaselines(layout, *averaged, result.is_known);
  if (!result.summary.success) throw Failure{QueryStatus::DIVERGED, "translation averaging failed"};
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    Rigid3d& frame_from_world = posed.frames[frame].frame_from_world;
    frame_from_world = CamFromWorld(frame_from_world.rotation, result.cams_in_world[frame]);
  }
}

// Returns true if most matches of a pair are near the epipolar lines of the poses: within two standard deviations of
// the noise that stages start with.
bool FitsPoses(const PosedImages& posed, const PairGeometry& pair) {
  constexpr double kMaxErrorPx = 2 * kStartNoisePx;
  const Rigid3d query_from_other = CamFromWorld(posed, pair.query) * Inverse(CamFromWorld(posed, pair.other));
  const auto num_near = std::count_if(pair.inliers.begin(), pair.inliers.end(), [&](const ObservedMatch& match) {
    return MeasureEpipolarError(query_from_other, match.query, match.other).squared_px <= kMaxErrorPx * kMaxErrorPx;
  });
  return 2 * num_near > static_cast<std::ptrdiff_t>(pair.inliers.size());
}

// Adds the pairs that fit the averaged poses although their rotation does not: points of a plane leave relative poses
// that are off by degrees.
void AddFittingPairs(const std::vector<PairGeometry>& pairs, Averaged* averaged) {
  PairRefs fitting;
  std::vector<RelativeDirection> directions;
  size_t next = 0;  // of those that agree, which are in the order of all
  for (const PairGeometry& pair : pairs) {
    const bool agrees = next < averaged->pairs.size() && averaged->pairs[next] == &pair;
    if (!agrees && !FitsPoses(averaged->posed, pair)) continue;
    fitting.push_back(&pair);
    directions.push_back(agrees ? averaged->directions[next++] : RelativeDirection());
  }
  averaged->pairs = std::move(fitting);
  averaged->directions = std::move(directions);
}

// Returns true if a single frame may be localized without motion averaging.
bool CanDoWithoutAveraging(const Failure& failure, const Layout& layout) {
  return layout.num_query_frames == 1 && failure.cause != QueryStatus::SCALE_UNOBSERVABLE &&
         failure.cause != QueryStatus::INCONSISTENT_RIG;
}

}  // namespace

Averaged AverageMotion(const Layout& layout, const std::vector<PairGeometry>& pairs, const LocalizerOptions& options,
                       StageTimer::Seconds* seconds, const AveragingMethods& methods) {
  Averaged averaged{layout.given, Refs(pairs), {}, {}};
  try {
    Timed("rotation", seconds, [&] { AverageRotation(layout, options, methods.rotations, &averaged); });
    Timed("directions", seconds, [&] { averaged.directions = EstimateDirections(layout, averaged); });
    Timed("translation", seconds, [&] { AverageTranslation(layout, methods.translations, &averaged); });
    AddFittingPairs(pairs, &averaged);
  } catch (const Failure& failure) {
    if (!CanDoWithoutAveraging(failure, layout)) throw;
    averaged.failure = failure;
  }
  averaged.directions.resize(averaged.pairs.size());
  return averaged;
}

}  // namespace lazyloc
