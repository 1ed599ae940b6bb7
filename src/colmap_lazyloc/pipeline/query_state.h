#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/pipeline/options.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/stage_timer.h"
#include "colmap_lazyloc/structure/track_building.h"
#include "colmap_lazyloc/translation/relative_direction.h"

namespace lazyloc {

// Ends the work on frames that cannot be localized.
struct QueryFailure {
  QueryStatus status;
  std::string reason;
  std::vector<int> frames = {};  // none: all of them
};

// A pair of a query on its way through the stages.
struct PairState {
  int query = 0;               // member of the group, and view
  int view = -1;               // of the other image: a database image, or an earlier query of the group
  int index = -1;              // into the query's pairs, or the group's query pairs
  RelativePose relative_pose;  // query from the other image
  ViewMatches view_matches;
  RelativeDirection direction;
};

// What the stages hand to each other for one group of queries. Views are the group's members, in their order, then the
// database images. A frame goes by its reference view. All coordinates are relative to `origin`: the solvers work near
// zero, wherever the database lies (UTM, ECEF).
struct QueryState {
  QueryState(const QueryGroup& query_group, const LocalizerOptions& query_options);

  int NumQueries() const { return static_cast<int>(group.images.size()); }
  const LocalizationProblem& Problem(int query) const { return group.images[query].problem; }
  bool HasDatabaseImage(const PairState& pair) const { return pair.view >= NumQueries(); }
  int FrameOf(int view) const { return ReferenceOf(views, view); }
  bool IsWithinFrame(const PairState& pair) const { return FrameOf(pair.view) == FrameOf(pair.query); }
  // The two images; `database_...` is the other one of two queries.
  const ImagePair& Images(const PairState& pair) const;
  // Of the tracks, those that each frame sees, by its reference view; and how many these are.
  std::vector<std::vector<Track>> TracksByFrame(const std::vector<Track>& of) const;
  std::vector<int> NumTracksByFrame(const std::vector<Track>& of) const;
  // The matches of a pair whose image points have rays.
  ViewMatches Observe(const PairState& pair, const Matches& matches);
  // By which the lengths within a frame have been multiplied.
  double RigScale(int frame) const;
  // The database's own pose of a view, whatever adjustment has made of it.
  Rigid3d GivenPose(size_t view) const;

  // A query whose focal length is sought is alone in its group.
  bool SeeksFocalLength() const { return views[0].log_focal_factor.has_value(); }
  // The tracks with their image points in the query (the first ones) seen by another camera, as far as it has rays
  // there.
  std::vector<Track> ObservedBy(const Camera& camera, const std::vector<Track>& given_tracks) const;
  // Changes the query's camera, and all of its observations with it.
  void ScaleFocalLength(double factor);

  const QueryGroup& group;
  const LocalizerOptions& options;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::vector<View> views;
  std::vector<int> frames;                   // ascending
  std::vector<std::vector<int>> pair_views;  // of each query's pairs
  std::vector<Camera> query_cameras;
  // By query and keypoint, as far as they are needed; none inside where the camera model has no ray there.
  std::vector<std::vector<std::optional<std::optional<Observation>>>> query_observations;
  std::vector<PairState> pairs;                   // those still in use
  std::optional<QueryFailure> averaging_failure;  // why motion averaging gave no poses
  std::vector<Track> candidates;                  // all tracks, points not set; none after the last round took them
  std::vector<Track> start_candidates;            // as many of them as a rough pose needs
  std::vector<Track> tracks_from_database;        // those that the database views triangulate by themselves
  std::vector<Track> tracks_with_query;           // the others, points not set
  std::vector<Track> tracks;                      // those that hold, in the last adjustment
  BundleAdjustmentResult adjustment;              // the last one
  std::vector<LocalizationResult> results;        // of the queries
  StageTimer::Seconds seconds;

 private:
  template <typename Visit>
  void VisitFrames(const std::vector<Track>& of, const Visit& visit) const;
  void AddQuery(const QueryImage& image);
  Rigid3d GivenCamFromReference(int query, int reference) const;
  void AddDatabaseViews();

  std::vector<const ImagePair*> database_images_;  // of the views after the queries
};

// Whether the focal length of a query is to be found.
bool SeeksFocalLength(const LocalizationProblem& problem, const LocalizerOptions& options);

// Throws a failure of the frames that `fails(frame)` has a reason for (optional text), if any.
template <typename Fails>
void CheckFrames(const QueryState& state, QueryStatus status, const Fails& fails) {
  QueryFailure failure{status, ""};
  for (const int frame : state.frames) {
    const std::optional<std::string> reason = fails(frame);
    if (!reason) continue;
    failure.reason = *reason;
    failure.frames.push_back(frame);
  }
  if (!failure.frames.empty()) throw failure;
}

}  // namespace lazyloc
