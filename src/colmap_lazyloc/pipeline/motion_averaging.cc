#include "colmap_lazyloc/pipeline/motion_averaging.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"
#include "colmap_lazyloc/pipeline/rig_check.h"

namespace lazyloc {
namespace {

using Reason = std::optional<std::string>;

void AddPair(PairState pair, QueryState* state) {
  const LocalizationProblem& query = state->Problem(pair.query);
  const ImagePair& images = state->Images(pair);
  const uint32_t seed = SeedFromNames(query.query_name, images.other_name, state->options.seed);
  std::optional<RelativePose> relative_pose = FindRelativePose(query, images, state->options.relative_pose, seed);
  if (!relative_pose) return;
  if (state->HasDatabaseImage(pair)) {
    state->results[pair.query].pairs[pair.index].num_inliers = static_cast<int>(relative_pose->inlier_matches.size());
  }
  pair.relative_pose = std::move(*relative_pose);
  state->pairs.push_back(std::move(pair));
}

void KeepAgreeingPairs(const std::vector<double>& rotation_errors_rad, double max_error_deg, QueryState* state) {
  struct Count {
    size_t num_pairs = 0, num_agreeing = 0, num_inliers = 0, num_agreeing_inliers = 0;
  };
  std::vector<Count> counts(state->NumQueries());  // by frame
  const auto agrees = [&](size_t i) { return rotation_errors_rad[i] <= DegToRad(max_error_deg); };
  for (size_t i = 0; i < state->pairs.size(); ++i) {
    const PairState& pair = state->pairs[i];
    const size_t num_inliers = pair.relative_pose.inlier_matches.size();
    std::vector<int> frames = {state->FrameOf(pair.query)};
    if (!state->HasDatabaseImage(pair) && !state->IsWithinFrame(pair)) frames.push_back(state->FrameOf(pair.view));
    for (const int frame : frames) {
      ++counts[frame].num_pairs;
      counts[frame].num_inliers += num_inliers;
      counts[frame].num_agreeing += agrees(i);
      counts[frame].num_agreeing_inliers += agrees(i) ? num_inliers : 0;
    }
  }
  CheckFrames(*state, QueryStatus::INCONSISTENT_ROTATIONS, [&](int frame) {
    // A lone pair is only believed where the others have little to set against it.
    const Count& count = counts[frame];
    if (count.num_pairs <= 1 || count.num_agreeing >= 2 || 2 * count.num_agreeing_inliers > count.num_inliers) {
      return Reason();
    }
    return Reason("no two of " + std::to_string(count.num_pairs) + " pairs agree on the query's rotation within " +
                  std::to_string(max_error_deg) + " deg");
  });
  std::vector<PairState> agreeing;
  for (size_t i = 0; i < state->pairs.size(); ++i) {
    if (agrees(i)) agreeing.push_back(std::move(state->pairs[i]));
  }
  state->pairs = std::move(agreeing);
}

// The nodes of averaging: first the frames, then database images. By query.
std::vector<int> FrameNodes(const QueryState& state) {
  std::vector<int> node_of_query(state.NumQueries(), -1);
  int num_nodes = 0;
  for (const int frame : state.frames) node_of_query[frame] = num_nodes++;
  for (int query = 0; query < state.NumQueries(); ++query) node_of_query[query] = node_of_query[state.FrameOf(query)];
  return node_of_query;
}

// The rotation of a query's frame, from that of the query.
Eigen::Quaterniond ToFrame(const View& query, const Eigen::Quaterniond& query_from_any) {
  if (!query.rig_link) return query_from_any;
  return query.rig_link->cam_from_reference.rotation.conjugate() * query_from_any;
}

// From the projection centre of a query's frame to that of the query.
Eigen::Vector3d OffsetInWorld(const QueryState& state, int query) {
  const View& view = state.views[query];
  if (!view.rig_link) return Eigen::Vector3d::Zero();
  const Eigen::Quaterniond& frame_from_world = state.views[view.rig_link->reference].cam_from_world.rotation;
  return frame_from_world.conjugate() * CamInWorld(view.rig_link->cam_from_reference);
}

// By variance.
double MeanStddev(double stddev1, double stddev2) { return std::sqrt((stddev1 * stddev1 + stddev2 * stddev2) / 2); }

}  // namespace

void KeepBestPairs(QueryState* state) {
  const size_t max_num_pairs = static_cast<size_t>(state->options.max_num_pairs);
  if (max_num_pairs == 0) return;
  std::vector<std::vector<PairState>> pairs_of_query(state->NumQueries());
  for (PairState& pair : state->pairs) pairs_of_query[pair.query].push_back(std::move(pair));
  state->pairs.clear();
  const auto has_more_inliers = [](const PairState& a, const PairState& b) {
    return a.relative_pose.inlier_matches.size() > b.relative_pose.inlier_matches.size();
  };
  for (std::vector<PairState>& pairs : pairs_of_query) {
    std::stable_sort(pairs.begin(), pairs.end(), has_more_inliers);
    if (pairs.size() > max_num_pairs) pairs.resize(max_num_pairs);
    std::sort(pairs.begin(), pairs.end(), [](const PairState& a, const PairState& b) { return a.index < b.index; });
    std::move(pairs.begin(), pairs.end(), std::back_inserter(state->pairs));
  }
}

void CheckLinks(const QueryState& state) {
  std::vector<size_t> num_listed(state.NumQueries(), 0);
  std::vector<bool> is_linked(state.NumQueries(), false);
  for (int query = 0; query < state.NumQueries(); ++query) {
    num_listed[state.FrameOf(query)] += state.Problem(query).pairs.size();
  }
  for (const PairState& pair : state.pairs) {
    if (!state.IsWithinFrame(pair)) is_linked[state.FrameOf(pair.query)] = true;
    if (!state.HasDatabaseImage(pair) && !state.IsWithinFrame(pair)) is_linked[state.FrameOf(pair.view)] = true;
  }
  CheckFrames(state, QueryStatus::TOO_FEW_INLIERS, [&](int frame) {
    if (is_linked[frame]) return Reason();
    return Reason("none of " + std::to_string(num_listed[frame]) + " pairs has " +
                  std::to_string(state.options.relative_pose.min_num_inliers) + " verified inliers");
  });
}

void FindRelativePoses(QueryState* state) {
  for (int query = 0; query < state->NumQueries(); ++query) {
    for (int i = 0; i < static_cast<int>(state->pair_views[query].size()); ++i) {
      AddPair({query, state->pair_views[query][i], i, {}, {}, {}}, state);
    }
  }
  KeepBestPairs(state);
  for (int i = 0; i < static_cast<int>(state->group.query_pairs.size()); ++i) {
    const QueryPair& pair = state->group.query_pairs[i];
    AddPair({pair.query, pair.other, i, {}, {}, {}}, state);
  }
  CheckLinks(*state);
}

void AverageRotation(QueryState* state) {
  const std::vector<int> node_of_query = FrameNodes(*state);
  RotationAveragingProblem problem;
  problem.rotations.assign(state->frames.size(), Eigen::Quaterniond::Identity());
  problem.is_fixed.assign(state->frames.size(), false);
  std::vector<int> edge_of_pair(state->pairs.size(), -1);
  for (size_t i = 0; i < state->pairs.size(); ++i) {
    const PairState& pair = state->pairs[i];
    if (state->IsWithinFrame(pair)) continue;
    edge_of_pair[i] = static_cast<int>(problem.edges.size());
    const View& other = state->views[pair.view];
    RotationEdge edge{-1, node_of_query[pair.query],
                      ToFrame(state->views[pair.query], pair.relative_pose.query_from_other.rotation),
                      static_cast<double>(pair.relative_pose.inlier_matches.size())};
    if (state->HasDatabaseImage(pair)) {
      edge.node1 = static_cast<int>(problem.rotations.size());
      problem.rotations.push_back(other.cam_from_world.rotation);
      problem.is_fixed.push_back(true);
    } else {
      edge.node1 = node_of_query[pair.view];
      if (other.rig_link) edge.node2_from_node1 = edge.node2_from_node1 * other.rig_link->cam_from_reference.rotation;
    }
    problem.edges.push_back(edge);
  }
  const RotationAveragingResult averaged = AverageRotations(problem, state->options.rotation_averaging);
  for (const int frame : state->frames) {
    state->views[frame].cam_from_world.rotation = averaged.rotations[node_of_query[frame]];
  }
  FollowReferences(&state->views);
  CheckFrames(*state, QueryStatus::TOO_FEW_INLIERS, [&](int frame) {
    if (averaged.is_known[node_of_query[frame]]) return Reason();
    return Reason("no pair links the query to the database, by other queries either");
  });
  std::vector<double> errors_rad(state->pairs.size(), 0);
  for (size_t i = 0; i < state->pairs.size(); ++i) {
    if (edge_of_pair[i] >= 0) errors_rad[i] = averaged.edge_errors_rad[edge_of_pair[i]];
  }
  const double max_error_deg =
      state->options.max_rotation_error_deg + 3 * std::max(0.0, state->options.database_pose_stddev_deg);
  CheckRigRotations(*state, errors_rad, max_error_deg);
  KeepAgreeingPairs(errors_rad, max_error_deg, state);
}

void EstimateDirections(QueryState* state) {
  for (PairState& pair : state->pairs) {
    if (state->IsWithinFrame(pair)) continue;
    const auto world_from = [&](int view) {
      return state->views[view].cam_from_world.rotation.conjugate().toRotationMatrix();
    };
    const Eigen::Matrix3d world_from_query = world_from(pair.query), world_from_other = world_from(pair.view);
    std::vector<RayPair> rays;
    rays.reserve(pair.view_matches.matches.size());
    for (size_t i = 0; i < pair.view_matches.matches.size(); ++i) {
      const Observation& other = pair.view_matches.database_observations[i];
      const Observation& query = pair.view_matches.query_observations[i];
      rays.push_back({world_from_other * other.ray_in_cam, world_from_query * query.ray_in_cam,
                      MeanStddev(RadFromPx(other), RadFromPx(query))});
    }
    pair.direction = EstimateRelativeDirection(rays);
  }
}

void AverageTranslation(QueryState* state) {
  const std::vector<int> node_of_query = FrameNodes(*state);
  TranslationAveragingProblem problem;
  problem.cams_in_world.assign(state->frames.size(), Eigen::Vector3d::Zero());
  problem.is_fixed.assign(state->frames.size(), false);
  std::vector<bool> has_edge(state->frames.size(), false);
  for (const PairState& pair : state->pairs) {
    // A direction that is not known to half a radian says nothing: the pair has no baseline to speak of.
    if (pair.direction.dir_1to2_in_world.isZero() || pair.direction.stddev_rad > 0.5) continue;
    DirectionEdge edge{-1, node_of_query[pair.query], pair.direction.dir_1to2_in_world, pair.direction.stddev_rad,
                       OffsetInWorld(*state, pair.query)};
    has_edge[edge.node2] = true;
    if (state->HasDatabaseImage(pair)) {
      edge.node1 = static_cast<int>(problem.cams_in_world.size());
      problem.cams_in_world.push_back(CamInWorld(state->views[pair.view].cam_from_world));
      problem.is_fixed.push_back(true);
    } else {
      edge.node1 = node_of_query[pair.view];
      edge.offset_in_world -= OffsetInWorld(*state, pair.view);
      has_edge[edge.node1] = true;
    }
    problem.edges.push_back(edge);
  }
  CheckBaselines([&](int frame) { return has_edge[node_of_query[frame]]; }, state);
  CheckPlaces(state);
  const TranslationAveragingResult averaged = AverageTranslations(problem, state->options.translation_averaging);
  CheckBaselines([&](int frame) { return averaged.is_known[node_of_query[frame]]; }, state);
  if (!averaged.summary.success) throw QueryFailure{QueryStatus::DIVERGED, "translation averaging failed"};
  for (const int frame : state->frames) {
    Rigid3d& cam_from_world = state->views[frame].cam_from_world;
    cam_from_world = CamFromWorld(cam_from_world.rotation, averaged.cams_in_world[node_of_query[frame]]);
  }
  FollowReferences(&state->views);
}

}  // namespace lazyloc
