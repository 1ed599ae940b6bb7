#include "colmap_lazyloc/pipeline/position_ambiguity.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/SVD>

#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

constexpr char kOnePlaceReason[] =
    "only one database position is usable: the direction from there is known, the distance is not";
// Above it a bearing says nothing.
constexpr double kMaxBearingStddevRad = 0.5;

bool IsDatabasePairOf(int frame, const PairState& pair, const QueryState& state) {
  return state.HasDatabaseImage(pair) && state.FrameOf(pair.query) == frame;
}

std::vector<Eigen::Vector3d> DatabaseCentres(const QueryState& state, int frame) {
  std::vector<Eigen::Vector3d> centres;
  for (const PairState& pair : state.pairs) {
    if (IsDatabasePairOf(frame, pair, state)) centres.push_back(CamInWorld(state.GivenPose(pair.view)));
  }
  return centres;
}

std::vector<int> QueriesOf(const QueryState& state, int frame) {
  std::vector<int> queries;
  for (int query = frame; query < state.NumQueries() && state.FrameOf(query) == frame; ++query) {
    queries.push_back(query);
  }
  return queries;
}

bool AreOnePlace(const std::vector<Eigen::Vector3d>& centres) {
  return std::all_of(centres.begin(), centres.end(), [&](const Eigen::Vector3d& centre) {
    return (centre - centres.front()).norm() <= 1e-9 * (1 + centre.norm());
  });
}

// Whether the deviation of the database images and the frame's from their best line is a small part of their length.
bool AreOnOneLine(const QueryState& state, int frame, double max_ratio) {
  std::vector<Eigen::Vector3d> places = DatabaseCentres(state, frame);
  for (const int query : QueriesOf(state, frame)) places.push_back(CamInWorld(state.views[query].cam_from_world));
  Eigen::Matrix3Xd offsets(3, places.size());
  for (size_t i = 0; i < places.size(); ++i) offsets.col(static_cast<Eigen::Index>(i)) = places[i];
  offsets.colwise() -= offsets.rowwise().mean().eval();
  const Eigen::Vector3d extents = Eigen::JacobiSVD<Eigen::Matrix3Xd>(offsets).singularValues();
  return extents[1] <= max_ratio * extents[0];
}

// Whether the image noise does not tell the points from points of one plane, n . X = 1 in the query's frame, i.e.
// n . ray = 1 / distance. What a point's inverse distance deviates from that shifts it along the epipolar line of an
// image at distance `baseline`, in rad.
bool AreInOnePlane(const View& query, const std::vector<Track>& tracks, double baseline) {
  Eigen::MatrixX3d rays(tracks.size(), 3);
  Eigen::VectorXd inverse_distances(tracks.size());
  for (Eigen::Index i = 0; i < rays.rows(); ++i) {
    const Eigen::Vector3d point_in_cam = query.cam_from_world * tracks[i].point_in_world;
    rays.row(i) = point_in_cam.normalized();
    inverse_distances[i] = 1 / point_in_cam.norm();
  }
  const Eigen::Vector3d normal = (rays.transpose() * rays).ldlt().solve(rays.transpose() * inverse_distances);
  const Eigen::ArrayXd shifts_rad = baseline * (rays * normal - inverse_distances).array().abs();
  std::vector<double> shifts_sigma;
  for (Eigen::Index i = 0; i < rays.rows(); ++i) {
    const Observation& observation = tracks[i].observations.front().observation;
    shifts_sigma.push_back(shifts_rad[i] / (RadFromPx(observation) * query.noise_px));
  }
  return Median(std::move(shifts_sigma)) <= 2;
}

// From the database image that leaves least doubt.
std::optional<Bearing> BestBearing(int query, const Eigen::Matrix3d& position_covariance, const QueryState& state) {
  std::optional<Bearing> best;
  for (const PairState& pair : state.pairs) {
    if (pair.query != query || !state.HasDatabaseImage(pair)) continue;
    const Eigen::Vector3d offset =
        CamInWorld(state.views[query].cam_from_world) - CamInWorld(state.GivenPose(pair.view));
    if (offset.isZero()) continue;
    const Eigen::Vector3d direction = offset.normalized();
    const Eigen::Matrix<double, 3, 2> basis = TangentBasis(direction);
    const Eigen::Matrix2d across = basis.transpose() * position_covariance * basis;
    const double half_trace = across.trace() / 2;
    const double variance = half_trace + std::sqrt(std::max(half_trace * half_trace - across.determinant(), 0.0));
    const double stddev_rad = std::sqrt(variance) / offset.norm();
    if (stddev_rad > kMaxBearingStddevRad || (best && stddev_rad > 0.999 * best->stddev_rad)) continue;
    best = Bearing{state.Images(pair).other_name, direction, stddev_rad};
  }
  return best;
}

std::string OpenDirectionReason(const PoseSpread& spread, double distance) {
  const double ratio = spread.position_stddevs[0] / distance;
  const Eigen::Vector3d& direction = spread.weakest_direction_in_world;
  char text[200];
  std::snprintf(
      text, sizeof(text),
      "the position is open along (%.2f, %.2f, %.2f) in the world: its standard deviation there is %s%.2g %% of "
      "the distance to the points",
      direction.x(), direction.y(), direction.z(), ratio > 1 ? "more than " : "", 100 * std::min(ratio, 1.0));
  return text;
}

}  // namespace

bool IsPositionOpen(const QueryState& state, int frame, const std::vector<Track>& tracks) {
  const View& view = state.views[frame];
  const PoseSpread spread = ComputePoseSpread(view.cam_from_world, state.adjustment.pose_covariances[frame]);
  const double distance = MedianDistance(view, tracks);
  const double stddev_ratio = std::max(spread.position_stddevs[0] / distance, spread.rotation_stddev_rad);
  if (!(stddev_ratio <= state.options.max_position_stddev_ratio)) return true;
  // On a line, only points that two database images see, or one and two queries, fix the position along it. Without
  // them it may have slid to a database image, where the covariance no longer shows that it could move.
  const auto num_common =
      std::count_if(tracks.begin(), tracks.end(), [](const Track& track) { return track.observations.size() > 2; });
  return num_common < state.options.min_num_tracks && AreOnOneLine(state, frame, 0.01);
}

QueryFailure FailWithOpenPosition(int frame, const std::vector<Track>& tracks, double variance_factor,
                                  QueryState* state) {
  const View& view = state->views[frame];
  const Rigid3d& pose = view.cam_from_world;
  const PoseSpread spread = ComputePoseSpread(pose, variance_factor * state->adjustment.pose_covariances[frame]);
  const std::vector<Eigen::Vector3d> centres = DatabaseCentres(*state, frame);
  const bool is_one_place = !centres.empty() && AreOnePlace(centres);
  if (is_one_place && AreInOnePlane(view, tracks, (CamInWorld(pose) - centres.front()).norm())) {
    return {QueryStatus::SCALE_UNOBSERVABLE,
            "only one database position is usable and all points lie in one plane: the distance is open, and two "
            "orientations explain the matches alike"};
  }
  for (const int query : QueriesOf(*state, frame)) {
    const Rigid3d& query_pose = state->views[query].cam_from_world;
    const Eigen::Matrix<double, 6, 6> covariance = variance_factor * state->adjustment.pose_covariances[query];
    state->results[query].partial_pose = {query_pose.rotation, spread.rotation_stddev_rad,
                                          BestBearing(query, PositionCovariance(query_pose, covariance), *state)};
  }
  if (is_one_place) {
    return {QueryStatus::SCALE_UNOBSERVABLE, kOnePlaceReason};
  }
  if (AreOnOneLine(*state, frame, 0.05)) {
    return {QueryStatus::DEGENERATE_BASELINE,
            "the database images and the query stand on one line, and too few points that two of the images see apart "
            "fix the position along it"};
  }
  return {QueryStatus::DEGENERATE_BASELINE, OpenDirectionReason(spread, MedianDistance(view, tracks))};
}

void CheckPlaces(QueryState* state) {
  std::vector<int> num_database_pairs(state->NumQueries(), 0);  // of frames without other queries
  for (const PairState& pair : state->pairs) {
    if (state->HasDatabaseImage(pair)) {
      ++num_database_pairs[pair.query];
    } else {
      num_database_pairs[pair.query] = num_database_pairs[pair.view] = std::numeric_limits<int>::min();
    }
  }
  CheckFrames(*state, QueryStatus::SCALE_UNOBSERVABLE, [&](int frame) -> std::optional<std::string> {
    if (num_database_pairs[frame] < 2 || QueriesOf(*state, frame).size() > 1) return std::nullopt;
    if (!AreOnePlace(DatabaseCentres(*state, frame))) return std::nullopt;
    const PairState* best = nullptr;
    for (const PairState& pair : state->pairs) {
      if (pair.query != frame || pair.direction.dir_1to2_in_world.isZero()) continue;
      if (!best || pair.direction.stddev_rad < best->direction.stddev_rad) best = &pair;
    }
    PartialPose partial = {state->views[frame].cam_from_world.rotation, std::nullopt, std::nullopt};
    if (best) {
      partial.bearing = {state->Images(*best).other_name, best->direction.dir_1to2_in_world,
                         best->direction.stddev_rad};
    }
    state->results[frame].partial_pose = partial;
    return kOnePlaceReason;
  });
}

void CheckBaselines(const std::function<bool(int frame)>& has_baseline, QueryState* state) {
  CheckFrames(*state, QueryStatus::DEGENERATE_BASELINE, [&](int frame) -> std::optional<std::string> {
    if (has_baseline(frame)) return std::nullopt;
    for (const int query : QueriesOf(*state, frame)) {
      state->results[query].partial_pose = {state->views[query].cam_from_world.rotation, std::nullopt, std::nullopt};
    }
    return "the query has no baseline to any of " + std::to_string(DatabaseCentres(*state, frame).size()) +
           " database images: its rotation is known, its position is not";
  });
}

}  // namespace lazyloc
