#pragma once

#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/structure/track_building.h"
#include "colmap_lazyloc/translation/relative_direction.h"

namespace lazyloc {

// Ends the work on a query that cannot be localized.
struct QueryFailure {
  QueryStatus status;
  std::string reason;
};

// A pair on its way through the stages. View i + 1 of the solvers is pair i; view 0 is the query.
struct PairState {
  int index = -1;  // into the problem's pairs
  RelativePose relative_pose;
  ViewMatches view_matches;
  RelativeDirection direction;
};

// What the stages hand to each other for one query. All coordinates are relative to `origin`: the solvers work near
// zero, wherever the database lies (UTM, ECEF).
struct QueryState {
  QueryState(const LocalizationProblem& query_problem, const LocalizerOptions& query_options);

  const View& DatabaseView(const PairState& pair) const { return views[pair.index + 1]; }
  bool SeeksFocalLength() const { return views[0].log_focal_factor.has_value(); }
  // The matches of a pair whose image points have rays.
  ViewMatches Observe(int pair_index, const Matches& matches);
  // The tracks with their image points in the query (the first ones) seen by another camera, as far as it has rays there.
  std::vector<Track> ObservedBy(const Camera& camera, const std::vector<Track>& given_tracks) const;
  // Changes the query's camera, and all of its observations with it.
  void ScaleFocalLength(double factor);
  // The database's own pose of a view, whatever adjustment has made of it.
  Rigid3d GivenPose(size_t view) const;

  const LocalizationProblem& problem;
  const LocalizerOptions& options;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::vector<View> views;
  Camera query_camera;
  // By keypoint, as far as they are needed; none inside where the camera model has no ray there.
  std::vector<std::optional<std::optional<Observation>>> query_observations;
  std::vector<PairState> pairs;                   // those still in use
  std::optional<QueryFailure> averaging_failure;  // why motion averaging gave no pose
  std::vector<Track> candidates;                  // all tracks, points not set
  std::vector<Track> start_candidates;            // as many of them as a rough pose needs
  std::vector<Track> tracks_from_database;        // those that the database views triangulate by themselves
  std::vector<Track> tracks_with_query;           // the others, points not set
  std::vector<Track> tracks;                      // those that hold, in the last adjustment
  BundleAdjustmentResult adjustment;              // the last one
  LocalizationResult result;
};

}  // namespace lazyloc
