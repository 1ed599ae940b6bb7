#include "colmap_lazyloc/structure/track_building.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lazyloc {
namespace {

ViewMatches MakeMatches(int view, const Matches& matches) {
  return {view, matches, std::vector<Observation>(matches.size()), std::vector<Observation>(matches.size())};
}

std::vector<std::pair<int, int>> Elements(const Track& track) {
  std::vector<std::pair<int, int>> elements;
  for (const TrackObservation& element : track.observations) elements.emplace_back(element.view, element.keypoint);
  return elements;
}

using Elements_ = std::vector<std::pair<int, int>>;

TEST(TrackBuilding, JoinsTheMatchesOfAQueryKeypoint) {
  const std::vector<Track> tracks =
      BuildTracks({MakeMatches(1, {{5, 50}, {7, 70}}), MakeMatches(2, {{7, 71}, {5, 51}})});
  ASSERT_EQ(tracks.size(), 2u);
  EXPECT_EQ(Elements(tracks[0]), (Elements_{{0, 5}, {1, 50}, {2, 51}}));
  EXPECT_EQ(Elements(tracks[1]), (Elements_{{0, 7}, {1, 70}, {2, 71}}));
}

TEST(TrackBuilding, DropsAmbiguousKeypointsOfAPair) {
  const std::vector<Track> tracks =
      BuildTracks({MakeMatches(1, {{5, 50}, {5, 52}, {6, 60}, {7, 60}, {8, 80}}), MakeMatches(2, {{5, 51}})});
  ASSERT_EQ(tracks.size(), 2u);
  EXPECT_EQ(Elements(tracks[0]), (Elements_{{0, 5}, {2, 51}})) << "the other pair's match stays";
  EXPECT_EQ(Elements(tracks[1]), (Elements_{{0, 8}, {1, 80}}));
}

TEST(TrackBuilding, NoMatchesNoTracks) { EXPECT_TRUE(BuildTracks({}).empty()); }

// Matches of keypoint i of the query with keypoint i of the other view.
ViewMatches Matched(int query_view, int view, const std::vector<uint32_t>& keypoints) {
  ViewMatches matches;
  matches.query_view = query_view;
  matches.view = view;
  for (const uint32_t keypoint : keypoints) matches.Add({keypoint, keypoint}, {}, {});
  return matches;
}

using ::testing::ElementsAre;
using ::testing::Pair;

TEST(TrackBuilding, OneQueryAmongSeveralIsAsAlone) {
  const std::vector<ViewMatches> matches = {MakeMatches(2, {{5, 50}, {5, 52}, {6, 60}, {8, 80}, {9, 90}}),
                                            MakeMatches(3, {{9, 90}, {5, 51}, {8, 81}})};
  const std::vector<Track> alone = BuildTracks(matches), among_others = BuildTracks(matches, /*num_queries=*/2);
  ASSERT_EQ(alone.size(), 4u);
  ASSERT_EQ(among_others.size(), alone.size());
  for (size_t i = 0; i < alone.size(); ++i) EXPECT_EQ(Elements(among_others[i]), Elements(alone[i]));
}

TEST(TrackBuilding, SeveralQueriesAreJoinedWhereTheDatabaseSaysLittle) {
  // Queries 0 to 2, database views 3 and 4. Keypoint 5 of query 1 has two database views: it stands alone.
  const std::vector<Track> tracks = BuildTracks({Matched(0, 3, {5, 7}), Matched(1, 3, {5}), Matched(1, 4, {5, 7}),
                                                 Matched(2, 0, {7}), Matched(2, 1, {5, 7, 8}), Matched(2, 3, {7})},
                                                /*num_queries=*/3);
  ASSERT_EQ(tracks.size(), 4u);
  EXPECT_THAT(Elements(tracks[0]), ElementsAre(Pair(0, 5), Pair(3, 5)));
  EXPECT_THAT(Elements(tracks[1]), ElementsAre(Pair(0, 7), Pair(1, 7), Pair(2, 7), Pair(3, 7), Pair(4, 7)));
  EXPECT_THAT(Elements(tracks[2]), ElementsAre(Pair(1, 5), Pair(2, 5), Pair(3, 5), Pair(4, 5)));
  EXPECT_THAT(Elements(tracks[3]), ElementsAre(Pair(1, 8), Pair(2, 8)));
}

TEST(TrackBuilding, ContradictoryTrackFallsApartIntoSingleQueries) {
  // By way of query 1, keypoints 1 and 2 of query 0 would be the same point.
  ViewMatches false_match = Matched(2, 0, {});
  false_match.Add({1, 2}, {}, {});
  const std::vector<Track> tracks =
      BuildTracks({Matched(0, 3, {1, 2}), Matched(1, 0, {1}), Matched(2, 1, {1}), false_match}, /*num_queries=*/3);
  ASSERT_EQ(tracks.size(), 2u);
  EXPECT_THAT(Elements(tracks[0]), ElementsAre(Pair(0, 1), Pair(3, 1)));
  EXPECT_THAT(Elements(tracks[1]), ElementsAre(Pair(0, 2), Pair(3, 2)));
}

}  // namespace
}  // namespace lazyloc
