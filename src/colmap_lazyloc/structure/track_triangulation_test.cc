#include "colmap_lazyloc/structure/track_triangulation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;

const Eigen::Vector3d kBehindAllCameras(0, 0, -1000);

// Triangulates tracks in both ways, as a round of the pipeline does.
std::vector<Track> TriangulateTracks(const PosedImages& posed, const std::vector<Track>& tracks,
                                     const TrackTriangulationOptions& options) {
  SplitTracks split = TriangulateFromDatabase(posed, tracks, options);
  std::vector<Track> triangulated =
      RemoveQueryOutliers(posed, std::move(split.from_database), options.max_query_error_sigma);
  for (const Track& track : TriangulateWithQuery(posed, split.rest, options)) triangulated.push_back(track);
  return triangulated;
}

// Displaces a track's keypoint in an image from the projection of its point.
void Displace(const Eigen::Vector2d& offset_px, int image, Track* track, const PosedImages& posed) {
  const Eigen::Vector3d point_in_cam = CamFromWorld(posed, image) * track->point_in_world;
  for (TrackObservation& element : track->observations) {
    if (element.image == image) element.observation = ObserveAt(point_in_cam, 500, offset_px);
  }
}

std::vector<int> ImagesOf(const Track& track) {
  std::vector<int> images;
  for (const TrackObservation& element : track.observations) images.push_back(element.image);
  return images;
}

// Returns the keypoint of each track's first observation; MakeSyntheticTracks numbers them like the tracks.
std::vector<int> KeypointsOf(const std::vector<Track>& tracks) {
  std::vector<int> keypoints;
  for (const Track& track : tracks) keypoints.push_back(track.observations.front().keypoint);
  return keypoints;
}

TEST(TrackTriangulation, NoiseFreeIsExact) {
  const SyntheticTracks scene = MakeSyntheticTracks({});
  std::vector<Track> tracks = scene.tracks;
  for (Track& track : tracks) track.point_in_world.setZero();
  const std::vector<Track> triangulated = TriangulateTracks(scene.posed, tracks, {});
  ASSERT_EQ(triangulated.size(), scene.tracks.size());
  for (size_t i = 0; i < triangulated.size(); ++i) {
    EXPECT_LE((triangulated[i].point_in_world - scene.tracks[i].point_in_world).norm(), 1e-8);
    EXPECT_EQ(triangulated[i].observations.size(), scene.tracks[i].observations.size());
  }
}

TEST(TrackTriangulation, ImagesOfARigStandWhereTheirFramePutsThem) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  // Gives database images 1 and 2 the frame of the first of them. Their poses remain.
  const Rigid3d cam2_from_world = CamFromWorld(scene.posed, 2);
  scene.posed.images[2].frame = 1;
  scene.posed.images[2].cam_from_frame = cam2_from_world * Inverse(scene.posed.frames[1].frame_from_world);
  scene.posed.frames[2].frame_from_world = {};
  std::vector<Track> tracks = scene.tracks;
  for (Track& track : tracks) {
    track.point_in_world.setZero();
    track.observations.resize(3);
  }
  const std::vector<Track> triangulated = TriangulateTracks(scene.posed, tracks, {});
  ASSERT_EQ(triangulated.size(), scene.tracks.size());
  for (size_t i = 0; i < triangulated.size(); ++i) {
    EXPECT_LE((triangulated[i].point_in_world - scene.tracks[i].point_in_world).norm(), 1e-8);
  }
}

TEST(TrackTriangulation, WrongQueryPoseDoesNotReachThePoints) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.posed.frames[0].frame_from_world.translation += Eigen::Vector3d(0.05, 0, 0);  // about 3 px at a depth of 8
  const std::vector<Track> triangulated = TriangulateTracks(scene.posed, scene.tracks, {});
  ASSERT_FALSE(triangulated.empty());
  for (const Track& track : triangulated) {
    EXPECT_LE((track.point_in_world - scene.tracks[track.observations[0].keypoint].point_in_world).norm(), 1e-8);
  }
}

TEST(TrackTriangulation, WrongDatabaseObservationIsRemoved) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  Track& track = scene.tracks[3];
  TrackObservation& wrong = track.observations[4];
  const Eigen::Vector3d wrong_point = track.point_in_world + Eigen::Vector3d(1, 1, 0);
  wrong.observation = ObserveAt(CamFromWorld(scene.posed, 4) * wrong_point, 500, Eigen::Vector2d::Zero());
  const std::vector<Track> triangulated = TriangulateTracks(scene.posed, {track}, {});
  ASSERT_EQ(triangulated.size(), 1u);
  EXPECT_LE((triangulated[0].point_in_world - track.point_in_world).norm(), 1e-8);
  EXPECT_THAT(ImagesOf(triangulated[0]), ElementsAre(0, 1, 2, 3, 5, 6));
}

TEST(TrackTriangulation, SplitKeepsTheOrder) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.tracks.resize(5);
  for (const int track : {1, 3}) scene.tracks[track].observations.resize(2);
  const SplitTracks split = TriangulateFromDatabase(scene.posed, scene.tracks, {});
  EXPECT_THAT(KeypointsOf(split.from_database), ElementsAre(0, 2, 4));
  EXPECT_THAT(KeypointsOf(split.rest), ElementsAre(1, 3));
}

TEST(TrackTriangulation, QueryFarFromThePointDropsTheTrack) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  Displace({5, 0}, 0, &scene.tracks[0], scene.posed);
  TrackTriangulationOptions options;
  EXPECT_EQ(TriangulateTracks(scene.posed, {scene.tracks[0]}, options).size(), 0u);
  options.max_query_error_sigma = 6;
  EXPECT_EQ(TriangulateTracks(scene.posed, {scene.tracks[0]}, options).size(), 1u);
  options.max_query_error_sigma = 4;
  scene.posed.images[0].noise_px = 2;
  EXPECT_EQ(TriangulateTracks(scene.posed, {scene.tracks[0]}, options).size(), 1u) << "5 px are 2.5 deviations";
}

TEST(TrackTriangulation, OneDatabaseImageNeedsTheQuery) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  for (Track& track : scene.tracks) track.observations.resize(2);
  const std::vector<Track> triangulated = TriangulateTracks(scene.posed, scene.tracks, {});
  ASSERT_FALSE(triangulated.empty());
  for (const Track& track : triangulated) {
    EXPECT_LE((track.point_in_world - scene.tracks[track.observations[0].keypoint].point_in_world).norm(), 1e-8);
    EXPECT_EQ(track.noise_ratio, TrackTriangulationOptions().single_image_noise_ratio);
  }
}

TEST(TrackTriangulation, DatabaseImagesAtOnePlaceCountAsOne) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  scene.posed.frames[2] = scene.posed.frames[1];  // of images 1 and 2
  const auto triangulate = [&](const Eigen::Vector2d& offset_px) {
    std::vector<Track> tracks = scene.tracks;
    for (Track& track : tracks) {
      track.observations.resize(3);
      track.observations[2].observation =
          ObserveAt(CamFromWorld(scene.posed, 2) * track.point_in_world, 500, offset_px);
    }
    return TriangulateTracks(scene.posed, tracks, {});
  };
  const std::vector<Track> triangulated = triangulate({0, 0});
  ASSERT_FALSE(triangulated.empty());
  for (const Track& track : triangulated) {
    EXPECT_EQ(track.observations.size(), 3u);
    EXPECT_EQ(track.noise_ratio, TrackTriangulationOptions().single_image_noise_ratio);
  }
  EXPECT_TRUE(triangulate({50, 0}).empty()) << "the database images disagree";
}

TEST(TrackTriangulation, SmallAngleAndPointsBehindAreDropped) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  TrackTriangulationOptions options;
  options.min_triangulation_angle_deg = 90;
  EXPECT_TRUE(TriangulateTracks(scene.posed, scene.tracks, options).empty());
  for (Track& track : scene.tracks) {
    for (TrackObservation& element : track.observations) element.observation.ray_in_cam *= -1;
  }
  EXPECT_TRUE(TriangulateTracks(scene.posed, scene.tracks, {}).empty());
}

TEST(TrackTriangulation, NoTracks) { EXPECT_TRUE(TriangulateTracks({}, {}, {}).empty()); }

TEST(RemoveOutliers, DropsTracksThatADatabaseImageContradictsOrThatLieBehind) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  Displace({0, 5}, 2, &scene.tracks[1], scene.posed);
  scene.tracks[3].point_in_world = kBehindAllCameras;
  EXPECT_EQ(RemoveOutliers(scene.posed, scene.tracks, 4).size(), scene.tracks.size() - 2);
  scene.posed.images[2].noise_px = 2;
  EXPECT_EQ(RemoveOutliers(scene.posed, scene.tracks, 4).size(), scene.tracks.size() - 1);
}

// Makes seven tracks of three queries and two database images. Track 1 has an outlier in query 1, track 2 in query 0,
// track 3 in database image 4, track 4 in all queries; track 5 is too short without its outlier in query 2.
SyntheticTracks MakeTracksWithOutliers() {
  SyntheticTracksOptions options;
  options.num_query = 3;
  options.num_database = 2;
  options.num_points = 7;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  scene.tracks[5].observations.erase(scene.tracks[5].observations.begin() + 3, scene.tracks[5].observations.end());
  scene.tracks[5].observations.erase(scene.tracks[5].observations.begin());
  for (const auto& [track, image] : {std::pair(1, 1), {2, 0}, {3, 4}, {4, 0}, {4, 1}, {4, 2}, {5, 2}}) {
    Displace({0, 5}, image, &scene.tracks[track], scene.posed);
  }
  return scene;
}

TEST(RemoveOutliers, KeepsTheOrderOfTracksAndObservations) {
  const SyntheticTracks scene = MakeTracksWithOutliers();
  const std::vector<Track> tracks = RemoveOutliers(scene.posed, scene.tracks, 4);
  ASSERT_THAT(KeypointsOf(tracks), ElementsAre(0, 1, 2, 6));
  EXPECT_THAT(ImagesOf(tracks[0]), ElementsAre(0, 1, 2, 3, 4));
  EXPECT_THAT(ImagesOf(tracks[1]), ElementsAre(0, 2, 3, 4));
  EXPECT_THAT(ImagesOf(tracks[2]), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(ImagesOf(tracks[3]), ElementsAre(0, 1, 2, 3, 4));
  for (const Track& track : tracks) {
    const Track& given = scene.tracks[track.observations[0].keypoint];
    EXPECT_EQ(track.point_in_world, given.point_in_world);
    for (const TrackObservation& element : track.observations) {
      EXPECT_EQ(element.observation.ray_in_cam, given.observations[element.image].observation.ray_in_cam);
    }
  }
}

TEST(RemoveQueryOutliers, KeepsTheOrderAndIgnoresDatabaseImages) {
  const SyntheticTracks scene = MakeTracksWithOutliers();
  const std::vector<Track> tracks = RemoveQueryOutliers(scene.posed, scene.tracks, 4);
  ASSERT_THAT(KeypointsOf(tracks), ElementsAre(0, 1, 2, 3, 6));
  EXPECT_THAT(ImagesOf(tracks[1]), ElementsAre(0, 2, 3, 4));
  EXPECT_THAT(ImagesOf(tracks[2]), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(ImagesOf(tracks[3]), ElementsAre(0, 1, 2, 3, 4));
}

// Displaces keypoints of queries by 5 standard deviations, which are less than 4 of noisier database images.
TEST(RemoveQueryOutliers, PointsAreNoMoreCertainThanTheirDatabaseImages) {
  SyntheticTracks scene = MakeTracksWithOutliers();
  for (const int image : {3, 4}) scene.posed.images[image].noise_px *= 1.2;
  EXPECT_EQ(RemoveQueryOutliers(scene.posed, scene.tracks, 4).size(), 5);
  scene.posed.images[4].noise_px *= 1.2;
  const std::vector<Track> tracks = RemoveQueryOutliers(scene.posed, scene.tracks, 4);
  ASSERT_THAT(KeypointsOf(tracks), ElementsAre(0, 1, 2, 3, 4, 6)) << "track 5 has no database image";
  EXPECT_THAT(ImagesOf(tracks[4]), ElementsAre(0, 1, 2, 3, 4));
}

}  // namespace
}  // namespace lazyloc
