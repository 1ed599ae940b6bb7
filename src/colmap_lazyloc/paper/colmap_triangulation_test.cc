#include "colmap_lazyloc/paper/colmap_triangulation.h"

#include <limits>

#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

SyntheticTracks MakeScene(double noise_px = 0) {
  SyntheticTracksOptions options;
  options.noise_px = noise_px;
  return MakeSyntheticTracks(options);
}

// Moves the keypoint of an observation by 100 px, at a focal length of 500 px more than 10 degrees.
void Spoil(const SyntheticTracks& scene, size_t index, Track* track) {
  TrackObservation& element = track->observations[index];
  element.observation =
      ObserveAt(CamFromWorld(scene.posed, element.image) * track->point_in_world, 500, Eigen::Vector2d(100, -80));
}

TEST(TriangulateWithColmap, NoiseFreeIsExact) {
  const SyntheticTracks scene = MakeScene();
  std::vector<Track> tracks = scene.tracks;
  for (Track& track : tracks) track.point_in_world.setZero();
  tracks = TriangulateWithColmap(scene.posed, tracks);
  ASSERT_EQ(tracks.size(), scene.tracks.size());
  for (size_t i = 0; i < tracks.size(); ++i) {
    EXPECT_LE((tracks[i].point_in_world - scene.tracks[i].point_in_world).norm(), 1e-9) << i;
    EXPECT_EQ(tracks[i].observations.size(), scene.tracks[i].observations.size()) << i;
  }
}

TEST(TriangulateWithColmap, WrongDatabaseObservationIsRemoved) {
  const SyntheticTracks scene = MakeScene(0.5);
  std::vector<Track> tracks = {scene.tracks[0]};
  const int wrong_image = tracks[0].observations[2].image;
  Spoil(scene, 2, &tracks[0]);
  tracks = TriangulateWithColmap(scene.posed, tracks);
  ASSERT_EQ(tracks.size(), 1u);
  ASSERT_EQ(tracks[0].observations.size(), scene.tracks[0].observations.size() - 1);
  for (const TrackObservation& element : tracks[0].observations) EXPECT_NE(element.image, wrong_image);
}

TEST(TriangulateWithColmap, TrackWithAWrongQueryObservationIsLeftOut) {
  const SyntheticTracks scene = MakeScene(0.5);
  std::vector<Track> tracks = {scene.tracks[0], scene.tracks[1]};
  Spoil(scene, 0, &tracks[0]);
  tracks = TriangulateWithColmap(scene.posed, tracks);
  ASSERT_EQ(tracks.size(), 1u);
  EXPECT_EQ(tracks[0].observations[0].keypoint, scene.tracks[1].observations[0].keypoint);
}

TEST(TriangulateWithColmap, TracksWithoutAPointAreLeftOut) {
  const SyntheticTracks scene = MakeScene();
  Track one_ray = scene.tracks[0], no_angle = scene.tracks[0], not_finite = scene.tracks[0];
  one_ray.observations.resize(1);
  no_angle.observations.resize(2);
  not_finite.observations.resize(2);
  not_finite.observations[0].observation.ray_in_cam.x() = std::numeric_limits<double>::quiet_NaN();
  PosedImages at_one_place = scene.posed;
  at_one_place.frames[at_one_place.images[no_angle.observations[1].image].frame].frame_from_world =
      CamFromWorld(scene.posed, 0);
  no_angle.observations[1].observation = no_angle.observations[0].observation;
  EXPECT_TRUE(TriangulateWithColmap(at_one_place, {no_angle}).empty());
  EXPECT_TRUE(TriangulateWithColmap(scene.posed, {one_ray, not_finite}).empty());
  EXPECT_TRUE(TriangulateWithColmap(scene.posed, {}).empty());
}

}  // namespace
}  // namespace lazyloc
