#include "colmap_lazyloc/structure/track_building.h"

#include <numeric>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/scene/refs.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

PairGeometry MakePair(int query, int other, const Matches& matches) {
  PairGeometry pair;
  pair.query = query;
  pair.other = other;
  pair.num_inliers = static_cast<int>(matches.size());
  for (const Match& match : matches) pair.inliers.push_back({match, {}, {}});
  return pair;
}

// Makes a pair that matches each of the keypoints with the keypoint of the same index.
PairGeometry MatchEqual(int query, int other, const std::vector<uint32_t>& keypoints) {
  Matches matches;
  for (const uint32_t keypoint : keypoints) matches.push_back({keypoint, keypoint});
  return MakePair(query, other, matches);
}

std::vector<Track> Build(const std::vector<PairGeometry>& pairs, const std::vector<int>& frame_of_query = {0}) {
  return BuildTracks(Refs(pairs), frame_of_query);
}

// Returns image and keypoint of each observation.
std::vector<std::pair<int, int>> Elements(const Track& track) {
  std::vector<std::pair<int, int>> elements;
  for (const TrackObservation& element : track.observations) elements.emplace_back(element.image, element.keypoint);
  return elements;
}

TEST(TrackBuilding, JoinsTheMatchesOfAQueryKeypoint) {
  const std::vector<Track> tracks = Build({MakePair(0, 1, {{5, 50}, {7, 70}}), MakePair(0, 2, {{7, 71}, {5, 51}})});
  ASSERT_EQ(tracks.size(), 2u);
  EXPECT_THAT(Elements(tracks[0]), ElementsAre(Pair(0, 5), Pair(1, 50), Pair(2, 51)));
  EXPECT_THAT(Elements(tracks[1]), ElementsAre(Pair(0, 7), Pair(1, 70), Pair(2, 71)));
}

TEST(TrackBuilding, KeepsTheObservationsOfTheMatches) {
  for (const std::vector<int>& frame_of_query : {std::vector<int>{0}, std::vector<int>{0, 1}}) {
    const int database = static_cast<int>(frame_of_query.size());
    PairGeometry pair = MakePair(0, database, {{5, 50}});
    pair.inliers[0].query.ray_in_cam = Eigen::Vector3d::UnitX();
    pair.inliers[0].other.ray_in_cam = Eigen::Vector3d::UnitY();
    const std::vector<Track> tracks = Build({pair}, frame_of_query);
    ASSERT_EQ(tracks.size(), 1u);
    EXPECT_THAT(Elements(tracks[0]), ElementsAre(Pair(0, 5), Pair(database, 50)));
    EXPECT_EQ(tracks[0].observations[0].observation.ray_in_cam, Eigen::Vector3d::UnitX());
    EXPECT_EQ(tracks[0].observations[1].observation.ray_in_cam, Eigen::Vector3d::UnitY());
  }
}

TEST(TrackBuilding, DropsAmbiguousKeypointsOfAPair) {
  const std::vector<Track> tracks =
      Build({MakePair(0, 1, {{5, 50}, {5, 52}, {6, 60}, {7, 60}, {8, 80}}), MakePair(0, 2, {{5, 51}})});
  ASSERT_EQ(tracks.size(), 2u);
  EXPECT_THAT(Elements(tracks[0]), ElementsAre(Pair(0, 5), Pair(2, 51))) << "the other pair's match stays";
  EXPECT_THAT(Elements(tracks[1]), ElementsAre(Pair(0, 8), Pair(1, 80)));
}

TEST(TrackBuilding, NoMatchesNoTracks) { EXPECT_TRUE(BuildTracks({}).empty()); }

TEST(TrackBuilding, OneQueryAmongSeveralIsAsAlone) {
  const std::vector<PairGeometry> pairs = {MakePair(0, 2, {{5, 50}, {5, 52}, {6, 60}, {8, 80}, {9, 90}}),
                                           MakePair(0, 3, {{9, 90}, {5, 51}, {8, 81}})};
  const std::vector<Track> alone = Build(pairs), among_others = Build(pairs, /*frame_of_query=*/{0, 1});
  ASSERT_EQ(alone.size(), 4u);
  ASSERT_EQ(among_others.size(), alone.size());
  for (size_t i = 0; i < alone.size(); ++i) EXPECT_EQ(Elements(among_others[i]), Elements(alone[i]));
}

TEST(TrackBuilding, QueriesWithFewOwnTracksAreMerged) {
  // Images 0 to 2 are queries, 3 and 4 database images. Keypoint 5 of query 1 has two database images: it makes a track
  // of its own.
  const std::vector<Track> tracks = Build({MatchEqual(0, 3, {5, 7}), MatchEqual(1, 3, {5}), MatchEqual(1, 4, {5, 7}),
                                           MatchEqual(2, 0, {7}), MatchEqual(2, 1, {5, 7, 8}), MatchEqual(2, 3, {7})},
                                          /*frame_of_query=*/{0, 1, 2});
  ASSERT_EQ(tracks.size(), 4u);
  EXPECT_THAT(Elements(tracks[0]), ElementsAre(Pair(0, 5), Pair(3, 5)));
  EXPECT_THAT(Elements(tracks[1]), ElementsAre(Pair(0, 7), Pair(1, 7), Pair(2, 7), Pair(3, 7), Pair(4, 7)));
  EXPECT_THAT(Elements(tracks[2]), ElementsAre(Pair(1, 5), Pair(2, 5), Pair(3, 5), Pair(4, 5)));
  EXPECT_THAT(Elements(tracks[3]), ElementsAre(Pair(1, 8), Pair(2, 8)));
}

TEST(TrackBuilding, QueriesWithEnoughOwnTracksAreNotMergedAcrossFrames) {
  std::vector<uint32_t> keypoints(100);
  std::iota(keypoints.begin(), keypoints.end(), 0);
  std::vector<PairGeometry> pairs;
  for (int query = 0; query < 2; ++query) {
    for (int database = 2; database < 4; ++database) pairs.push_back(MatchEqual(query, database, keypoints));
  }
  pairs.push_back(MatchEqual(1, 0, {200}));
  EXPECT_EQ(Build(pairs, {0, 1}).size(), 200u);
  EXPECT_EQ(Build(pairs, {0, 0}).size(), 201u) << "queries of one frame";
  pairs.resize(3);  // leaves one database image to the second query
  pairs.push_back(MatchEqual(1, 0, {200}));
  EXPECT_EQ(Build(pairs, {0, 1}).size(), 201u);
}

TEST(TrackBuilding, ContradictoryTrackIsSplitIntoSingleQueries) {
  // Merges keypoints 1 and 2 of query 0 by way of query 1.
  const std::vector<Track> tracks =
      Build({MatchEqual(0, 3, {1, 2}), MatchEqual(1, 0, {1}), MatchEqual(2, 1, {1}), MakePair(2, 0, {{1, 2}})},
            /*frame_of_query=*/{0, 1, 2});
  ASSERT_EQ(tracks.size(), 2u);
  EXPECT_THAT(Elements(tracks[0]), ElementsAre(Pair(0, 1), Pair(3, 1)));
  EXPECT_THAT(Elements(tracks[1]), ElementsAre(Pair(0, 2), Pair(3, 2)));
}

}  // namespace
}  // namespace lazyloc
