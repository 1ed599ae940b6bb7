#include "colmap_lazyloc/pipeline/motion_averaging.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"

namespace lazyloc {
namespace {

void KeepAgreeingPairs(const std::vector<double>& rotation_errors_rad, QueryState* state) {
  const LocalizerOptions& options = state->options;
  const double max_error_deg = options.max_rotation_error_deg + 3 * std::max(0.0, options.database_pose_stddev_deg);
  const auto agrees = [&](size_t i) { return rotation_errors_rad[i] <= DegToRad(max_error_deg); };
  size_t num_agreeing = 0, num_inliers = 0, num_agreeing_inliers = 0;
  for (size_t i = 0; i < state->pairs.size(); ++i) {
    const size_t num_pair_inliers = state->pairs[i].relative_pose.inlier_matches.size();
    num_inliers += num_pair_inliers;
    if (!agrees(i)) continue;
    num_agreeing_inliers += num_pair_inliers;
    ++num_agreeing;
  }
  // A lone pair is only believed where the others have little to set against it.
  if (state->pairs.size() > 1 && num_agreeing < 2 && 2 * num_agreeing_inliers <= num_inliers) {
    throw QueryFailure{QueryStatus::INCONSISTENT_ROTATIONS, "no two of " + std::to_string(state->pairs.size()) +
                                                                " pairs agree on the query's rotation within " +
                                                                std::to_string(max_error_deg) + " deg"};
  }
  std::vector<PairState> agreeing;
  for (size_t i = 0; i < state->pairs.size(); ++i) {
    if (agrees(i)) agreeing.push_back(std::move(state->pairs[i]));
  }
  state->pairs = std::move(agreeing);
}

// By variance.
double MeanStddev(double stddev1, double stddev2) { return std::sqrt((stddev1 * stddev1 + stddev2 * stddev2) / 2); }

}  // namespace

void KeepBestPairs(QueryState* state) {
  if (state->pairs.empty()) {
    throw QueryFailure{QueryStatus::TOO_FEW_INLIERS,
                       "none of " + std::to_string(state->problem.pairs.size()) + " pairs has " +
                           std::to_string(state->options.relative_pose.min_num_inliers) + " verified inliers"};
  }
  const size_t max_num_pairs = static_cast<size_t>(state->options.max_num_pairs);
  if (max_num_pairs == 0 || state->pairs.size() <= max_num_pairs) return;
  const auto has_more_inliers = [](const PairState& a, const PairState& b) {
    return a.relative_pose.inlier_matches.size() > b.relative_pose.inlier_matches.size();
  };
  std::stable_sort(state->pairs.begin(), state->pairs.end(), has_more_inliers);
  state->pairs.resize(max_num_pairs);
  std::sort(state->pairs.begin(), state->pairs.end(),
            [](const PairState& a, const PairState& b) { return a.index < b.index; });
}

void FindRelativePoses(QueryState* state) {
  for (size_t i = 0; i < state->problem.pairs.size(); ++i) {
    const ImagePair& pair = state->problem.pairs[i];
    const uint32_t seed = SeedFromNames(state->problem.query_name, pair.database_name, state->options.seed);
    std::optional<RelativePose> relative_pose =
        FindRelativePose(state->problem, pair, state->options.relative_pose, seed);
    if (!relative_pose) continue;
    state->result.pairs[i].num_inliers = static_cast<int>(relative_pose->inlier_matches.size());
    state->pairs.push_back({static_cast<int>(i), std::move(*relative_pose), {}, {}});
  }
  KeepBestPairs(state);
}

void AverageRotation(QueryState* state) {
  RotationAveragingProblem problem;
  problem.rotations.emplace_back(Eigen::Quaterniond::Identity());
  problem.is_fixed.push_back(false);
  for (const PairState& pair : state->pairs) {
    problem.edges.push_back({static_cast<int>(problem.rotations.size()), 0,
                             pair.relative_pose.query_from_database.rotation,
                             static_cast<double>(pair.relative_pose.inlier_matches.size())});
    problem.rotations.push_back(state->DatabaseView(pair).cam_from_world.rotation);
    problem.is_fixed.push_back(true);
  }
  const RotationAveragingResult averaged = AverageRotations(problem, state->options.rotation_averaging);
  state->views[0].cam_from_world.rotation = averaged.rotations[0];
  KeepAgreeingPairs(averaged.edge_errors_rad, state);
}

void EstimateDirections(QueryState* state) {
  for (PairState& pair : state->pairs) {
    const Eigen::Matrix3d world_from_query = state->views[0].cam_from_world.rotation.conjugate().toRotationMatrix();
    const Eigen::Matrix3d world_from_database =
        state->DatabaseView(pair).cam_from_world.rotation.conjugate().toRotationMatrix();
    std::vector<RayPair> rays;
    rays.reserve(pair.view_matches.matches.size());
    for (size_t i = 0; i < pair.view_matches.matches.size(); ++i) {
      const Observation& database = pair.view_matches.database_observations[i];
      const Observation& query = pair.view_matches.query_observations[i];
      rays.push_back({world_from_database * database.ray_in_cam, world_from_query * query.ray_in_cam,
                      MeanStddev(RadFromPx(database), RadFromPx(query))});
    }
    pair.direction = EstimateRelativeDirection(rays);
  }
}

void AverageTranslation(QueryState* state) {
  TranslationAveragingProblem problem;
  problem.cams_in_world.emplace_back(Eigen::Vector3d::Zero());
  problem.is_fixed.push_back(false);
  for (const PairState& pair : state->pairs) {
    // A direction that is not known to half a radian says nothing: the pair has no baseline to speak of.
    if (pair.direction.dir_1to2_in_world.isZero() || pair.direction.stddev_rad > 0.5) continue;
    problem.edges.push_back({static_cast<int>(problem.cams_in_world.size()), 0, pair.direction.dir_1to2_in_world,
                             pair.direction.stddev_rad});
    problem.cams_in_world.push_back(CamInWorld(state->DatabaseView(pair).cam_from_world));
    problem.is_fixed.push_back(true);
  }
  if (problem.edges.empty()) throw FailWithoutBaseline(state);
  if (std::optional<QueryFailure> failure = FailAtOnePlace(state)) throw *failure;
  const TranslationAveragingResult averaged = AverageTranslations(problem, state->options.translation_averaging);
  if (!averaged.summary.success) throw QueryFailure{QueryStatus::DIVERGED, "translation averaging failed"};
  state->views[0].cam_from_world = CamFromWorld(state->views[0].cam_from_world.rotation, averaged.cams_in_world[0]);
}

}  // namespace lazyloc
