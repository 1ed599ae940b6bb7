#include "colmap_lazyloc/group/track_collection.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;

constexpr int kNumPoints = 60, kNumDatabaseImages = 3;

// Counts the tracks by the query of their first observation.
std::vector<int> NumTracksByQuery(const std::vector<Track>& tracks, int num_queries) {
  std::vector<int> num_tracks(num_queries, 0);
  for (const Track& track : tracks) ++num_tracks[track.observations.front().image];
  return num_tracks;
}

std::set<std::pair<int, int>> FirstObservations(const std::vector<Track>& tracks) {
  std::set<std::pair<int, int>> keypoints;
  for (const Track& track : tracks) {
    keypoints.emplace(track.observations.front().image, track.observations.front().keypoint);
  }
  return keypoints;
}

TEST(CollectTracks, EachKeypointHasATrackWithItsDatabaseImages) {
  const SyntheticGroup scene = MakeGroup(2, 2, kNumPoints, kNumDatabaseImages);
  const StageInput input = MakeStageInput(scene);
  const CandidateTracks candidates = CollectTracks(scene.group, input.layout, Refs(input.pairs));
  EXPECT_THAT(NumTracksByQuery(candidates.all, 4), ElementsAre(kNumPoints, kNumPoints, kNumPoints, kNumPoints));
  for (const Track& track : candidates.all) {
    const TrackObservation& query = track.observations.front();
    const Track& truth = input.tracks[query.image * kNumPoints + query.keypoint];
    ASSERT_EQ(track.observations.size(), truth.observations.size());
    for (size_t i = 0; i < truth.observations.size(); ++i) {
      EXPECT_EQ(track.observations[i].image, truth.observations[i].image);
      EXPECT_EQ(track.observations[i].keypoint, truth.observations[i].keypoint);
      EXPECT_EQ(track.observations[i].observation.ray_in_cam, truth.observations[i].observation.ray_in_cam);
    }
  }
}

TEST(CollectTracks, LimitOfTheStartHoldsForEachQuery) {
  constexpr int kManyPoints = kMaxNumStartTracks + 50;
  for (const int num_sensors : {1, 3}) {
    const SyntheticGroup scene = MakeGroup(1, num_sensors, kManyPoints, kNumDatabaseImages);
    const StageInput input = MakeStageInput(scene);
    const CandidateTracks candidates = CollectTracks(scene.group, input.layout, Refs(input.pairs));
    EXPECT_EQ(NumTracksByQuery(candidates.all, num_sensors), std::vector<int>(num_sensors, kManyPoints));
    EXPECT_EQ(NumTracksByQuery(candidates.for_start, num_sensors), std::vector<int>(num_sensors, kMaxNumStartTracks));
    const auto all = FirstObservations(candidates.all), for_start = FirstObservations(candidates.for_start);
    EXPECT_TRUE(std::includes(all.begin(), all.end(), for_start.begin(), for_start.end()));
  }
}

TEST(CollectTracks, OnlyTheGivenPairsAreUsed) {
  const SyntheticGroup scene = MakeGroup(1, 1, kNumPoints, kNumDatabaseImages);
  const StageInput input = MakeStageInput(scene);
  const PairRefs pairs = {&input.pairs[0], &input.pairs[2]};
  const CandidateTracks candidates = CollectTracks(scene.group, input.layout, pairs);
  ASSERT_EQ(candidates.all.size(), static_cast<size_t>(kNumPoints));
  EXPECT_EQ(candidates.for_start.size(), candidates.all.size());
  for (const Track& track : candidates.all) {
    ASSERT_EQ(track.observations.size(), 3u);
    EXPECT_EQ(track.observations[1].image, input.pairs[0].other);
    EXPECT_EQ(track.observations[2].image, input.pairs[2].other);
  }
}

}  // namespace
}  // namespace lazyloc
