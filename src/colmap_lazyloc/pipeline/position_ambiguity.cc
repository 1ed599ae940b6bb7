#include "colmap_lazyloc/pipeline/position_ambiguity.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <Eigen/Cholesky>
#include <Eigen/SVD>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

constexpr char kOnePlaceReason[] =
    "only one database position is usable: the direction from there is known, the distance is not";
// Above it a bearing says nothing.
constexpr double kMaxBearingStddevRad = 0.5;

std::vector<Eigen::Vector3d> DatabaseCentres(const QueryState& state) {
  std::vector<Eigen::Vector3d> centres;
  for (const PairState& pair : state.pairs) centres.push_back(CamInWorld(state.GivenPose(pair.index + 1)));
  return centres;
}

bool AreOnePlace(const std::vector<Eigen::Vector3d>& centres) {
  return std::all_of(centres.begin(), centres.end(), [&](const Eigen::Vector3d& centre) {
    return (centre - centres.front()).norm() <= 1e-9 * (1 + centre.norm());
  });
}

// Whether the deviation of the database images and the query from their best line is a small part of their length.
bool AreOnOneLine(const QueryState& state, double max_ratio) {
  std::vector<Eigen::Vector3d> places = DatabaseCentres(state);
  places.push_back(CamInWorld(state.views[0].cam_from_world));
  Eigen::Matrix3Xd offsets(3, places.size());
  for (size_t i = 0; i < places.size(); ++i) offsets.col(static_cast<Eigen::Index>(i)) = places[i];
  offsets.colwise() -= offsets.rowwise().mean().eval();
  const Eigen::Vector3d extents = Eigen::JacobiSVD<Eigen::Matrix3Xd>(offsets).singularValues();
  return extents[1] <= max_ratio * extents[0];
}

// Whether the image noise does not tell the points from points of one plane, n . X = 1 in the query's frame, i.e.
// n . ray = 1 / distance. What a point's inverse distance deviates from that shifts it along the epipolar line of an
// image at distance `baseline`, in rad.
bool AreInOnePlane(const QueryState& state, double baseline) {
  const View& query = state.views[0];
  Eigen::MatrixX3d rays(state.tracks.size(), 3);
  Eigen::VectorXd inverse_distances(state.tracks.size());
  for (Eigen::Index i = 0; i < rays.rows(); ++i) {
    const Eigen::Vector3d point_in_cam = query.cam_from_world * state.tracks[i].point_in_world;
    rays.row(i) = point_in_cam.normalized();
    inverse_distances[i] = 1 / point_in_cam.norm();
  }
  const Eigen::Vector3d normal = (rays.transpose() * rays).ldlt().solve(rays.transpose() * inverse_distances);
  const Eigen::ArrayXd shifts_rad = baseline * (rays * normal - inverse_distances).array().abs();
  std::vector<double> shifts_sigma;
  for (Eigen::Index i = 0; i < rays.rows(); ++i) {
    const Observation& observation = state.tracks[i].observations.front().observation;
    shifts_sigma.push_back(shifts_rad[i] / (RadFromPx(observation) * query.noise_px));
  }
  const auto middle = shifts_sigma.begin() + static_cast<std::ptrdiff_t>(shifts_sigma.size() / 2);
  std::nth_element(shifts_sigma.begin(), middle, shifts_sigma.end());
  return *middle <= 2;
}

// From the database image that leaves least doubt.
std::optional<Bearing> BestBearing(const Eigen::Matrix3d& position_covariance, const QueryState& state) {
  std::optional<Bearing> best;
  for (const PairState& pair : state.pairs) {
    const Eigen::Vector3d offset =
        CamInWorld(state.views[0].cam_from_world) - CamInWorld(state.GivenPose(pair.index + 1));
    if (offset.isZero()) continue;
    const Eigen::Vector3d direction = offset.normalized();
    const Eigen::Matrix<double, 3, 2> basis = TangentBasis(direction);
    const Eigen::Matrix2d across = basis.transpose() * position_covariance * basis;
    const double half_trace = across.trace() / 2;
    const double variance = half_trace + std::sqrt(std::max(half_trace * half_trace - across.determinant(), 0.0));
    const double stddev_rad = std::sqrt(variance) / offset.norm();
    if (stddev_rad > kMaxBearingStddevRad || (best && stddev_rad > 0.999 * best->stddev_rad)) continue;
    best = Bearing{state.problem.pairs[pair.index].database_name, direction, stddev_rad};
  }
  return best;
}

std::string OpenDirectionReason(const PoseSpread& spread, const QueryState& state) {
  const double ratio = spread.position_stddevs[0] / MedianDistance(state.views[0], state.tracks);
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

bool IsPositionOpen(const QueryState& state) {
  const PoseSpread spread = ComputePoseSpread(state.views[0].cam_from_world, state.adjustment.pose_covariances[0]);
  const double distance = MedianDistance(state.views[0], state.tracks);
  const double stddev_ratio = std::max(spread.position_stddevs[0] / distance, spread.rotation_stddev_rad);
  if (!(stddev_ratio <= state.options.max_position_stddev_ratio)) return true;
  // On a line, only points that two database images see fix the position along it. Without them it may have slid to a
  // database image, where the covariance no longer shows that it could move.
  const auto num_common = std::count_if(state.tracks.begin(), state.tracks.end(),
                                        [](const Track& track) { return track.observations.size() > 2; });
  return num_common < state.options.min_num_tracks && AreOnOneLine(state, 0.01);
}

QueryFailure FailWithOpenPosition(const Eigen::Matrix<double, 6, 6>& covariance, QueryState* state) {
  const Rigid3d& pose = state->views[0].cam_from_world;
  const PoseSpread spread = ComputePoseSpread(pose, covariance);
  const std::vector<Eigen::Vector3d> centres = DatabaseCentres(*state);
  const bool is_one_place = AreOnePlace(centres);
  const double baseline = (CamInWorld(pose) - centres.front()).norm();
  if (is_one_place && AreInOnePlane(*state, baseline)) {
    return {QueryStatus::SCALE_UNOBSERVABLE,
            "only one database position is usable and all points lie in one plane: the distance is open, and two "
            "orientations explain the matches alike"};
  }
  state->result.partial_pose = {pose.rotation, spread.rotation_stddev_rad,
                                BestBearing(PositionCovariance(pose, covariance), *state)};
  if (is_one_place) {
    return {QueryStatus::SCALE_UNOBSERVABLE, kOnePlaceReason};
  }
  if (AreOnOneLine(*state, 0.05)) {
    return {QueryStatus::DEGENERATE_BASELINE,
            "the database images and the query stand on one line, and too few points that two of the images see apart "
            "fix the position along it"};
  }
  return {QueryStatus::DEGENERATE_BASELINE, OpenDirectionReason(spread, *state)};
}

std::optional<QueryFailure> FailAtOnePlace(QueryState* state) {
  if (state->pairs.size() < 2 || !AreOnePlace(DatabaseCentres(*state))) return std::nullopt;
  const PairState* best = nullptr;
  for (const PairState& pair : state->pairs) {
    if (pair.direction.dir_1to2_in_world.isZero()) continue;
    if (!best || pair.direction.stddev_rad < best->direction.stddev_rad) best = &pair;
  }
  state->result.partial_pose = {state->views[0].cam_from_world.rotation, std::nullopt, std::nullopt};
  if (best) {
    state->result.partial_pose->bearing = {state->problem.pairs[best->index].database_name,
                                           best->direction.dir_1to2_in_world, best->direction.stddev_rad};
  }
  return QueryFailure{QueryStatus::SCALE_UNOBSERVABLE, kOnePlaceReason};
}

QueryFailure FailWithoutBaseline(QueryState* state) {
  state->result.partial_pose = {state->views[0].cam_from_world.rotation, std::nullopt, std::nullopt};
  return {QueryStatus::DEGENERATE_BASELINE, "the query has no baseline to any of " +
                                                std::to_string(state->pairs.size()) +
                                                " database images: its rotation is known, its position is not"};
}

}  // namespace lazyloc
