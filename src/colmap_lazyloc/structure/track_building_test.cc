#include "colmap_lazyloc/structure/track_building.h"

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

}  // namespace
}  // namespace lazyloc
