#include "colmap_lazyloc/structure/track_triangulation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

// Both kinds, as a round of the pipeline takes them.
std::vector<Track> TriangulateTracks(const std::vector<View>& views, const std::vector<Track>& tracks,
                                     const TrackTriangulationOptions& options) {
  std::vector<Track> rest;
  std::vector<Track> triangulated =
      TracksFittingQuery(views, TriangulateFromDatabase(views, tracks, options, &rest), options.max_query_error_sigma);
  for (const Track& track : TriangulateWithQuery(views, rest, options)) triangulated.push_back(track);
  return triangulated;
}

TEST(TrackTriangulation, NoiseFreeIsExact) {
  const SyntheticTracks scene = MakeSyntheticTracks({});
  std::vector<Track> tracks = scene.tracks;
  for (Track& track : tracks) track.point_in_world.setZero();
  const std::vector<Track> triangulated = TriangulateTracks(scene.views, tracks, {});
  ASSERT_EQ(triangulated.size(), scene.tracks.size());
  for (size_t i = 0; i < triangulated.size(); ++i) {
    EXPECT_LE((triangulated[i].point_in_world - scene.tracks[i].point_in_world).norm(), 1e-8);
    EXPECT_EQ(triangulated[i].observations.size(), scene.tracks[i].observations.size());
  }
}

TEST(TrackTriangulation, WrongQueryPoseDoesNotReachThePoints) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.views[0].cam_from_world.translation += Eigen::Vector3d(0.05, 0, 0);  // some 3 px at a depth of 8
  for (const Track& track : TriangulateTracks(scene.views, scene.tracks, {})) {
    EXPECT_LE((track.point_in_world - scene.tracks[track.observations[0].keypoint].point_in_world).norm(), 1e-8);
  }
}

TEST(TrackTriangulation, WrongDatabaseObservationIsLeftOut) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  Track& track = scene.tracks[3];
  TrackObservation& wrong = track.observations[4];
  wrong.observation = ObserveAt(scene.views[4].cam_from_world * (track.point_in_world + Eigen::Vector3d(1, 1, 0)), 500,
                                Eigen::Vector2d::Zero());
  const std::vector<Track> triangulated = TriangulateTracks(scene.views, {track}, {});
  ASSERT_EQ(triangulated.size(), 1u);
  EXPECT_LE((triangulated[0].point_in_world - track.point_in_world).norm(), 1e-8);
  for (const TrackObservation& element : triangulated[0].observations) EXPECT_NE(element.view, 4);
}

TEST(TrackTriangulation, QueryFarFromThePointDropsTheTrack) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Eigen::Vector3d point_in_cam = scene.views[0].cam_from_world * scene.tracks[0].point_in_world;
  scene.tracks[0].observations[0].observation = ObserveAt(point_in_cam, 500, {5, 0});
  TrackTriangulationOptions options;
  EXPECT_EQ(TriangulateTracks(scene.views, {scene.tracks[0]}, options).size(), 0u);
  options.max_query_error_sigma = 6;
  EXPECT_EQ(TriangulateTracks(scene.views, {scene.tracks[0]}, options).size(), 1u);
  options.max_query_error_sigma = 4;
  scene.views[0].noise_px = 2;
  EXPECT_EQ(TriangulateTracks(scene.views, {scene.tracks[0]}, options).size(), 1u) << "5 px are 2.5 deviations";
}

TEST(TrackTriangulation, OneDatabaseViewNeedsTheQuery) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  for (Track& track : scene.tracks) track.observations.resize(2);
  const std::vector<Track> triangulated = TriangulateTracks(scene.views, scene.tracks, {});
  ASSERT_FALSE(triangulated.empty());
  for (const Track& track : triangulated) {
    EXPECT_LE((track.point_in_world - scene.tracks[track.observations[0].keypoint].point_in_world).norm(), 1e-8);
  }
}

TEST(TrackTriangulation, SmallAngleAndPointsBehindAreDropped) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  TrackTriangulationOptions options;
  options.min_triangulation_angle_deg = 90;
  EXPECT_TRUE(TriangulateTracks(scene.views, scene.tracks, options).empty());
  for (Track& track : scene.tracks) {
    for (TrackObservation& element : track.observations) element.observation.ray_in_cam *= -1;
  }
  EXPECT_TRUE(TriangulateTracks(scene.views, scene.tracks, {}).empty());
}

TEST(FittingTracks, LeavesOutWhatIsFarOrBehind) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  const Eigen::Vector3d point_in_cam = scene.views[2].cam_from_world * scene.tracks[1].point_in_world;
  scene.tracks[1].observations[2].observation = ObserveAt(point_in_cam, 500, {0, 5});
  scene.tracks[3].point_in_world = {0, 0, -1000};
  const std::vector<Track> fitting = FittingTracks(scene.views, scene.tracks, 4);
  EXPECT_EQ(fitting.size(), scene.tracks.size() - 2);
  scene.views[2].noise_px = 2;
  EXPECT_EQ(FittingTracks(scene.views, scene.tracks, 4).size(), scene.tracks.size() - 1);
}

TEST(TrackTriangulation, NoTracks) { EXPECT_TRUE(TriangulateTracks({}, {}, {}).empty()); }

}  // namespace
}  // namespace lazyloc
