#include "colmap_lazyloc/uncertainty/position_ambiguity.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/SVD>

#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/scene/plane_fit.h"
#include "colmap_lazyloc/scene/pose_distribution.h"

namespace lazyloc {
namespace {

constexpr char kOnePlaceReason[] =
    "only one database position is usable: the direction from there is known, the distance is not";
// Maximum standard deviation of the rotation of a pose that is observable.
constexpr double kMaxRotationStddevRad = 0.1;
// Maximum standard deviation of a bearing that is worth reporting.
constexpr double kMaxBearingStddevRad = 0.5;

PoseSpread SpreadOf(const AdjustedFrame& frame) {
  const BundleAdjustmentResult& adjustment = frame.adjustment;
  return MakePoseDistribution(adjustment.posed.frames[frame.frame].frame_from_world,
                              frame.variance_factor * adjustment.frame_covariances[frame.frame])
      .Spread();
}

// Returns the centres of the database images that a query frame has pairs with, one per pair.
std::vector<Eigen::Vector3d> DatabaseCentres(const Layout& layout, const PairRefs& pairs, int frame) {
  std::vector<Eigen::Vector3d> centres;
  for (const PairGeometry* pair : pairs) {
    if (!layout.IsDatabase(pair->other) || layout.FrameOf(pair->query) != frame) continue;
    centres.push_back(CamInWorld(CamFromWorld(layout.given, pair->other)));
  }
  return centres;
}

// Returns true if the adjustment used the position prior of an image of the frame.
bool HasPositionPrior(const AdjustedFrame& frame) {
  const std::vector<ImagePrior>& priors = frame.adjustment.posed.query_priors;
  return std::any_of(priors.begin(), priors.end(), [&](const ImagePrior& prior) {
    return prior.prior.position && frame.layout.FrameOf(prior.image) == frame.frame;
  });
}

bool AreOnePlace(const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return (a - b).norm() <= 1e-9 * (1 + a.norm()); }

bool AreOnePlace(const std::vector<Eigen::Vector3d>& centres) {
  return std::all_of(centres.begin(), centres.end(),
                     [&](const Eigen::Vector3d& centre) { return AreOnePlace(centre, centres.front()); });
}

// Returns true if the deviation of the frame's centres and its database images' from their best line is less than
// max_ratio of their extent.
bool AreOnOneLine(const AdjustedFrame& frame, double max_ratio) {
  std::vector<Eigen::Vector3d> places = DatabaseCentres(frame.layout, frame.pairs, frame.frame);
  for (const int query : frame.layout.QueriesOf(frame.frame)) {
    places.push_back(CamInWorld(CamFromWorld(frame.adjustment.posed, query)));
  }
  Eigen::Matrix3Xd offsets(3, places.size());
  for (size_t i = 0; i < places.size(); ++i) offsets.col(static_cast<Eigen::Index>(i)) = places[i];
  offsets.colwise() -= offsets.rowwise().mean().eval();
  const Eigen::VectorXd extents = Eigen::JacobiSVD<Eigen::Matrix3Xd>(offsets).singularValues();  // at most one a place
  return extents.size() < 2 || extents[1] <= max_ratio * extents[0];
}

// Returns true if the image noise does not distinguish the points from points of one plane. A deviation of a point's
// inverse distance from that of the plane moves its keypoint along the epipolar line of an image at distance
// `baseline`, in rad.
bool AreInOnePlane(const AdjustedFrame& frame, double baseline) {
  const Rigid3d& frame_from_world = frame.adjustment.posed.frames[frame.frame].frame_from_world;
  const double noise_px = frame.adjustment.posed.images[frame.layout.QueriesOf(frame.frame).front()].noise_px;
  const Eigen::ArrayXd shifts_rad = baseline * FitPlane(frame_from_world, frame.tracks).errors.array().abs();
  std::vector<double> shifts_sigma;
  for (Eigen::Index i = 0; i < shifts_rad.size(); ++i) {
    const Observation& observation = frame.tracks[i]->observations.front().observation;
    shifts_sigma.push_back(shifts_rad[i] / (RadFromPx(observation) * noise_px));
  }
  return Median(std::move(shifts_sigma)) <= 2;
}

// Returns the bearing of a query from the database image that leaves the least uncertainty.
std::optional<Bearing> BestBearing(const AdjustedFrame& frame, int query, const Rigid3d& query_from_world,
                                   const Eigen::Matrix3d& position_covariance) {
  std::optional<Bearing> best;
  for (const PairGeometry* pair : frame.pairs) {
    if (pair->query != query || !frame.layout.IsDatabase(pair->other)) continue;
    const Eigen::Vector3d offset =
        CamInWorld(query_from_world) - CamInWorld(CamFromWorld(frame.layout.given, pair->other));
    if (offset.isZero()) continue;
    const Eigen::Vector3d direction = offset.normalized();
    const Eigen::Matrix<double, 3, 2> basis = TangentBasis(direction);
    const Eigen::Matrix2d across = basis.transpose() * position_covariance * basis;
    const double half_trace = across.trace() / 2;
    const double variance = half_trace + std::sqrt(std::max(half_trace * half_trace - across.determinant(), 0.0));
    const double stddev_rad = std::sqrt(variance) / offset.norm();
    if (stddev_rad > kMaxBearingStddevRad || (best && stddev_rad > 0.999 * best->stddev_rad)) continue;
    best = Bearing{frame.layout.names[pair->other], direction, stddev_rad};
  }
  return best;
}

std::string UnobservableDirectionReason(const PoseSpread& spread, double distance) {
  const double ratio = spread.position_stddevs[0] / distance;
  const Eigen::Vector3d& direction = spread.weakest_direction_in_world;
  return Format(
      "the position is unobservable along (%.2f, %.2f, %.2f) in the world: its standard deviation there is %s%.2g %% "
      "of the distance to the points",
      direction.x(), direction.y(), direction.z(), ratio > 1 ? "more than " : "", 100 * std::min(ratio, 1.0));
}

}  // namespace

int CountCommonTracks(const PosedImages& posed, const TrackRefs& tracks) {
  std::vector<Eigen::Vector3d> centres;  // by image
  for (const Rigid3d& cam_from_world : CamsFromWorld(posed)) centres.push_back(CamInWorld(cam_from_world));
  return static_cast<int>(std::count_if(tracks.begin(), tracks.end(), [&](const Track* track) {
    std::vector<Eigen::Vector3d> places;
    for (const TrackObservation& element : track->observations) {
      const Eigen::Vector3d& centre = centres[element.image];
      const bool is_new = std::none_of(places.begin(), places.end(),
                                       [&](const Eigen::Vector3d& place) { return AreOnePlace(centre, place); });
      if (is_new) places.push_back(centre);
    }
    return places.size() > 2;
  }));
}

int CountTracksWithDepth(const PosedImages& posed, const TrackRefs& tracks) {
  return static_cast<int>(std::count_if(tracks.begin(), tracks.end(), [&](const Track* track) {
    return std::any_of(track->observations.begin(), track->observations.end(), [&](const TrackObservation& element) {
      return element.depth > 0 && posed.images[element.image].depth_scale;
    });
  }));
}

bool FixDistance(const PosedImages& posed, const TrackRefs& tracks) {
  return CountTracksWithDepth(posed, tracks) >= kMinNumTracks && CountCommonTracks(posed, tracks) < kMinNumTracks;
}

bool IsPositionUnobservable(const AdjustedFrame& frame, const LocalizerOptions& options) {
  const PosedImages& posed = frame.adjustment.posed;
  const Rigid3d& frame_from_world = posed.frames[frame.frame].frame_from_world;
  const PoseSpread spread = SpreadOf(frame);
  if (!(spread.rotation_stddev_rad <= kMaxRotationStddevRad)) return true;
  if (HasPositionPrior(frame)) return false;
  const double distance = MedianDistance(frame_from_world, frame.tracks);
  if (!(spread.position_stddevs[0] <= options.max_position_stddev_ratio * distance)) return true;
  // On a line, only depths, or points that are seen from two other places, fix the position along it. Without them the
  // position may have moved onto a database image, where the covariance no longer shows that it can move.
  return AreOnOneLine(frame, 0.01) && CountTracksWithDepth(posed, frame.tracks) < kMinNumTracks &&
         CountCommonTracks(posed, frame.tracks) < kMinNumTracks;
}

Failure UnobservablePositionFailure(const AdjustedFrame& frame) {
  const BundleAdjustmentResult& adjustment = frame.adjustment;
  const Rigid3d& pose = adjustment.posed.frames[frame.frame].frame_from_world;
  const PoseSpread spread = SpreadOf(frame);
  const std::vector<Eigen::Vector3d> centres = DatabaseCentres(frame.layout, frame.pairs, frame.frame);
  const bool is_one_place = !centres.empty() && AreOnePlace(centres);
  const auto leaves_two_orientations = [&] {
    if (frame.has_one_orientation) return !*frame.has_one_orientation;
    return AreInOnePlane(frame, (CamInWorld(pose) - centres.front()).norm());
  };
  if (is_one_place && leaves_two_orientations()) {
    return {QueryStatus::SCALE_UNOBSERVABLE,
            "only one database position is usable and all points lie in one plane: the distance is unobservable, "
            "and two orientations explain the matches alike"};
  }
  Failure failure{QueryStatus::DEGENERATE_BASELINE, ""};
  for (const int query : frame.layout.QueriesOf(frame.frame)) {
    const Rigid3d query_from_world = CamFromWorld(adjustment.posed, query);
    const Eigen::Matrix3d position_covariance =
        MakePoseDistribution(query_from_world, frame.variance_factor * adjustment.image_covariances[query])
            .PositionCovariance();
    failure.partial_poses[query] = {query_from_world.rotation, spread.rotation_stddev_rad,
                                    BestBearing(frame, query, query_from_world, position_covariance)};
  }
  if (is_one_place) {
    failure.cause = QueryStatus::SCALE_UNOBSERVABLE;
    failure.reason = kOnePlaceReason;
  } else if (AreOnOneLine(frame, 0.05)) {
    failure.reason =
        "the database images and the query stand on one line, and too few points that two of the images see apart "
        "fix the position along it";
  } else {
    failure.reason = UnobservableDirectionReason(spread, MedianDistance(pose, frame.tracks));
  }
  return failure;
}

void CheckPlaces(const Layout& layout, const Averaged& averaged) {
  std::vector<int> num_database_pairs(layout.num_query_frames, 0);
  std::vector<bool> has_other_queries(layout.num_query_frames, false);
  for (const PairGeometry* pair : averaged.pairs) {
    const int frame = layout.FrameOf(pair->query);
    if (layout.IsDatabase(pair->other)) {
      ++num_database_pairs[frame];
    } else {
      has_other_queries[frame] = has_other_queries[layout.FrameOf(pair->other)] = true;
    }
  }
  Failure failure{QueryStatus::SCALE_UNOBSERVABLE, kOnePlaceReason};
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    const std::vector<int> queries = layout.QueriesOf(frame);
    if (num_database_pairs[frame] < 2 || has_other_queries[frame] || queries.size() > 1) continue;
    if (!AreOnePlace(DatabaseCentres(layout, averaged.pairs, frame))) continue;
    PartialPose partial = {averaged.posed.frames[frame].frame_from_world.rotation, std::nullopt, std::nullopt};
    for (size_t k = 0; k < averaged.pairs.size(); ++k) {
      const RelativeDirection& direction = averaged.directions[k];
      if (averaged.pairs[k]->query != queries.front() || direction.dir_1to2_in_world.isZero()) continue;
      if (partial.bearing && direction.stddev_rad >= partial.bearing->stddev_rad) continue;
      partial.bearing = {layout.names[averaged.pairs[k]->other], direction.dir_1to2_in_world, direction.stddev_rad};
    }
    failure.partial_poses[queries.front()] = partial;
    failure.frames.push_back(frame);
  }
  if (!failure.frames.empty()) throw failure;
}

void CheckBaselines(const Layout& layout, const Averaged& averaged, const std::vector<bool>& has_baseline) {
  Failure failure{QueryStatus::DEGENERATE_BASELINE, ""};
  for (int frame = 0; frame < layout.num_query_frames; ++frame) {
    if (has_baseline[frame]) continue;
    for (const int query : layout.QueriesOf(frame)) {
      failure.partial_poses[query] = {CamFromWorld(averaged.posed, query).rotation, std::nullopt, std::nullopt};
    }
    failure.Add(frame, "the query has no baseline to any of " +
                           std::to_string(DatabaseCentres(layout, averaged.pairs, frame).size()) +
                           " database images: its rotation is known, its position is not");
  }
  if (!failure.frames.empty()) throw failure;
}

}  // namespace lazyloc
