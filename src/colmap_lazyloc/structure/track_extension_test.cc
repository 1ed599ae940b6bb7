#include "colmap_lazyloc/structure/track_extension.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

using Keypoints = std::vector<std::pair<uint32_t, uint32_t>>;

// Query keypoint 0 seen at keypoint 10 of view 1.
Track MakeTrack() {
  Track track;
  track.observations = {{0, 0, {}}, {2, 10, {}}};
  return track;
}

std::optional<Observation> ObserveAll(int, uint32_t keypoint) {
  if (keypoint == 99) return std::nullopt;
  Observation observation;
  observation.ray_in_cam.x() = keypoint;
  return observation;
}

std::vector<std::pair<int, int>> Extended(const std::vector<DatabaseViewMatches>& matches) {
  std::vector<Track> tracks = {MakeTrack()};
  ExtendTracks(matches, ObserveAll, &tracks);
  std::vector<std::pair<int, int>> elements;
  for (const TrackObservation& element : tracks[0].observations) elements.emplace_back(element.view, element.keypoint);
  return elements;
}

TEST(TrackExtension, FollowsMatchesInBothDirectionsInOrderOfViews) {
  const Keypoints to_three = {{10, 30}, {11, 31}}, from_one = {{5, 10}};
  EXPECT_THAT(
      Extended({{2, 3, &to_three}, {1, 2, &from_one}}),
      testing::ElementsAre(testing::Pair(0, 0), testing::Pair(1, 5), testing::Pair(2, 10), testing::Pair(3, 30)));
}

TEST(TrackExtension, ViewsThatTheTrackHasStayAsTheyAre) {
  const Keypoints to_query = {{10, 7}};
  EXPECT_THAT(Extended({{2, 0, &to_query}}), testing::ElementsAre(testing::Pair(0, 0), testing::Pair(2, 10)));
}

TEST(TrackExtension, ContradictingMatchesAddNothing) {
  const Keypoints first = {{10, 30}}, second = {{10, 31}};
  EXPECT_EQ(Extended({{2, 3, &first}, {2, 3, &second}}).size(), 2u);
  EXPECT_EQ(Extended({{2, 3, &first}, {2, 3, &first}}).size(), 3u);
}

TEST(TrackExtension, NewImagePointsAreNotFollowed) {
  const Keypoints first = {{10, 30}}, second = {{30, 40}};
  EXPECT_EQ(Extended({{2, 3, &first}, {3, 4, &second}}).size(), 3u);
}

TEST(TrackExtension, KeypointsWithoutARayAreLeftOut) {
  const Keypoints matches = {{10, 99}};
  EXPECT_EQ(Extended({{2, 3, &matches}}).size(), 2u);
}

TEST(TrackExtension, TracksMayShareADatabaseKeypoint) {
  const Keypoints matches = {{10, 30}};
  std::vector<Track> tracks = {MakeTrack(), MakeTrack()};
  ExtendTracks({{2, 3, &matches}}, ObserveAll, &tracks);
  for (const Track& track : tracks) EXPECT_EQ(track.observations.size(), 3u);
}

}  // namespace
}  // namespace lazyloc
