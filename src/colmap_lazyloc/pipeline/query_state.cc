#include "colmap_lazyloc/pipeline/query_state.h"

#include <limits>
#include <map>

#include "colmap_lazyloc/bridge/observation.h"

namespace lazyloc {

bool SeeksFocalLength(const LocalizationProblem& problem, const LocalizerOptions& options) {
  const Camera& camera = problem.query_camera;
  const bool has_focal_length = !SameIntrinsics(WithFocalFactor(camera, 2), camera);
  return options.refine_focal_length && has_focal_length && !camera.has_prior_focal_length;
}

QueryState::QueryState(const QueryGroup& query_group, const LocalizerOptions& query_options)
    : group(query_group), options(query_options), pair_views(query_group.images.size()) {
  size_t num_pairs = 0;
  for (const QueryImage& image : group.images) num_pairs += image.problem.pairs.size();
  for (const QueryImage& image : group.images) {
    AddQuery(image);
    for (const ImagePair& pair : image.problem.pairs) {
      origin += CamInWorld(pair.database_cam_from_world) / static_cast<double>(num_pairs);
    }
  }
  if (NumQueries() == 1 && lazyloc::SeeksFocalLength(Problem(0), options)) views[0].log_focal_factor = 0;
  for (const View& view : views) {
    if (view.rig_link && !group.has_rig_scale) views[view.rig_link->reference].seeks_rig_scale = true;
  }
  AddDatabaseViews();
}

void QueryState::AddQuery(const QueryImage& image) {
  const int query = static_cast<int>(views.size());
  views.emplace_back();
  if (query == 0 || group.images[query - 1].frame != image.frame) {
    frames.push_back(query);
  } else {
    views.back().rig_link = RigLink{frames.back(), GivenCamFromReference(query, frames.back())};
  }
  query_cameras.push_back(image.problem.query_camera);
  query_observations.emplace_back(image.problem.query_keypoints.size());
  LocalizationResult result;
  result.query_name = image.problem.query_name;
  result.query_camera = image.problem.query_camera;
  result.frame_name = group.frame_names[image.frame];
  for (const ImagePair& pair : image.problem.pairs) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    result.pairs.push_back({pair.other_name, 0, kNone, kNone});
  }
  results.push_back(std::move(result));
}

Rigid3d QueryState::GivenCamFromReference(int query, int reference) const {
  return group.images[query].cam_from_rig * Inverse(group.images[reference].cam_from_rig);
}

double QueryState::RigScale(int frame) const {
  double length = 0, given_length = 0;
  for (int query = frame + 1; query < NumQueries() && FrameOf(query) == frame; ++query) {
    length += views[query].rig_link->cam_from_reference.translation.norm();
    given_length += GivenCamFromReference(query, frame).translation.norm();
  }
  return given_length > 0 ? length / given_length : 1;
}

// Each frame has views of its own for its database images: what adjustment corrects in them is as much what the frame
// makes of its surroundings as an error of the pose.
void QueryState::AddDatabaseViews() {
  std::map<std::pair<int, std::string>, int> view_of_image;  // by frame and name
  for (int query = 0; query < NumQueries(); ++query) {
    for (const ImagePair& pair : Problem(query).pairs) {
      const auto [view, is_new] =
          view_of_image.emplace(std::make_pair(FrameOf(query), pair.other_name), static_cast<int>(views.size()));
      pair_views[query].push_back(view->second);
      if (!is_new) continue;
      database_images_.push_back(&pair);
      views.push_back({GivenPose(view->second), /*is_database=*/true});
    }
  }
}

const ImagePair& QueryState::Images(const PairState& pair) const {
  return HasDatabaseImage(pair) ? Problem(pair.query).pairs[pair.index] : group.query_pairs[pair.index].images;
}

Rigid3d QueryState::GivenPose(size_t view) const {
  Rigid3d cam_from_world = database_images_[view - group.images.size()]->database_cam_from_world;
  cam_from_world.rotation.normalize();
  cam_from_world.translation += cam_from_world.rotation * origin;
  return cam_from_world;
}

template <typename Visit>
void QueryState::VisitFrames(const std::vector<Track>& of, const Visit& visit) const {
  for (const Track& track : of) {
    int last_frame = -1;
    for (const TrackObservation& element : track.observations) {
      if (element.view >= NumQueries() || FrameOf(element.view) == last_frame) continue;
      last_frame = FrameOf(element.view);
      visit(last_frame, track);
    }
  }
}

std::vector<std::vector<Track>> QueryState::TracksByFrame(const std::vector<Track>& of) const {
  std::vector<std::vector<Track>> tracks_of(NumQueries());
  VisitFrames(of, [&](int frame, const Track& track) { tracks_of[frame].push_back(track); });
  return tracks_of;
}

std::vector<int> QueryState::NumTracksByFrame(const std::vector<Track>& of) const {
  std::vector<int> num_tracks(NumQueries(), 0);
  VisitFrames(of, [&](int frame, const Track&) { ++num_tracks[frame]; });
  return num_tracks;
}

ViewMatches QueryState::Observe(const PairState& pair, const Matches& matches) {
  const ImagePair& images = Images(pair);
  const bool is_query_pair = !HasDatabaseImage(pair);
  const Observer observe_query(query_cameras[pair.query], SeeksFocalLength()),
      observe_other(is_query_pair ? query_cameras[pair.view] : images.other_camera);
  const auto observe = [&](int query, uint32_t keypoint, const Observer& observer) {
    std::optional<std::optional<Observation>>& observation = query_observations[query][keypoint];
    if (!observation) observation = observer(Problem(query).query_keypoints[keypoint]);
    return *observation;
  };
  ViewMatches observed;
  observed.query_view = pair.query;
  observed.view = pair.view;
  observed.Reserve(matches.size());
  for (const Match& match : matches) {
    const std::optional<Observation> query = observe(pair.query, match.query_point, observe_query);
    const std::optional<Observation> other = is_query_pair
                                                 ? observe(pair.view, match.other_point, observe_other)
                                                 : observe_other(images.other_keypoints[match.other_point]);
    if (query && other) observed.Add(match, *query, *other);
  }
  return observed;
}

void QueryState::ScaleFocalLength(double factor) {
  query_cameras[0] = WithFocalFactor(query_cameras[0], factor);
  query_observations[0].assign(Problem(0).query_keypoints.size(), std::nullopt);
  for (PairState& pair : pairs) pair.view_matches = Observe(pair, pair.view_matches.matches);
  for (std::vector<Track>* some :
       {&candidates, &start_candidates, &tracks_from_database, &tracks_with_query, &tracks}) {
    *some = ObservedBy(query_cameras[0], *some);
  }
}

std::vector<Track> QueryState::ObservedBy(const Camera& camera, const std::vector<Track>& given_tracks) const {
  const Observer observe(camera, SeeksFocalLength());
  std::vector<Track> observed;
  for (const Track& track : given_tracks) {
    const std::optional<Observation> query = observe(Problem(0).query_keypoints[track.observations.front().keypoint]);
    if (!query) continue;
    observed.push_back(track);
    observed.back().observations.front().observation = *query;
  }
  return observed;
}

}  // namespace lazyloc
