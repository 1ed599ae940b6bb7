#include "colmap_lazyloc/structure/track_selection.h"

#include <set>

#include <gtest/gtest.h>

namespace lazyloc {
namespace {

Track MakeTrack(int keypoint, int num_observations) {
  Track track;
  for (int image = 0; image < num_observations; ++image) track.observations.push_back({image, keypoint, {}});
  return track;
}

TEST(TrackSelection, FewTracksStayAsTheyAre) {
  const std::vector<Eigen::Vector2d> keypoints = {{0, 0}, {1, 1}};
  EXPECT_EQ(SelectTracks({MakeTrack(0, 2), MakeTrack(1, 3)}, keypoints, 2).size(), 2u);
  EXPECT_TRUE(SelectTracks({}, keypoints, 2).empty());
}

TEST(TrackSelection, TakesTheLongestTracksOfOnePlace) {
  const std::vector<Eigen::Vector2d> keypoints(4, {5, 5});
  const std::vector<Track> selected =
      SelectTracks({MakeTrack(0, 2), MakeTrack(1, 4), MakeTrack(2, 3), MakeTrack(3, 4)}, keypoints, 2);
  ASSERT_EQ(selected.size(), 2u);
  EXPECT_EQ(selected[0].observations[0].keypoint, 1);
  EXPECT_EQ(selected[1].observations[0].keypoint, 3);
}

TEST(TrackSelection, EveryPartOfTheImageKeepsTracks) {
  // Puts many long tracks into one corner, and one short track into each other corner.
  std::vector<Eigen::Vector2d> keypoints;
  std::vector<Track> tracks;
  for (int i = 0; i < 100; ++i) {
    keypoints.emplace_back(i % 10, i / 10);
    tracks.push_back(MakeTrack(i, 10));
  }
  for (const Eigen::Vector2d& corner : {Eigen::Vector2d(640, 0), Eigen::Vector2d(0, 480), Eigen::Vector2d(640, 480)}) {
    tracks.push_back(MakeTrack(static_cast<int>(keypoints.size()), 2));
    keypoints.push_back(corner);
  }
  std::set<int> selected;
  for (const Track& track : SelectTracks(tracks, keypoints, 10)) {
    EXPECT_TRUE(selected.insert(track.observations[0].keypoint).second);
  }
  EXPECT_EQ(selected.size(), 10u);
  for (const int corner : {100, 101, 102}) EXPECT_EQ(selected.count(corner), 1u);
}

}  // namespace
}  // namespace lazyloc
