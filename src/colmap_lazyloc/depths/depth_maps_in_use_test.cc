#include "colmap_lazyloc/depths/depth_maps_in_use.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/stage_input.h"

namespace lazyloc {
namespace {

using ::testing::Each;
using ::testing::IsEmpty;

// A group with depth maps, and what WithDepthMaps returns.
struct MapsInUse {
  MapsInUse(int num_database_images, int num_sensors, int num_frames = 1) {
    SyntheticGroupOptions group;
    group.num_database_images = num_database_images;
    group.num_sensors = num_sensors;
    group.num_frames = num_frames;
    group.has_query_pairs = false;
    scene = MakeSyntheticGroup(group);
    for (QueryImage& image : scene.group.images) {
      for (ImagePair& pair : image.problem.pairs) pair.other_depths = TrueDepths(pair);
    }
  }

  std::vector<float> TrueDepths(const ImagePair& pair) const {
    std::vector<float> depths;
    for (const Eigen::Vector3d& point : scene.points_in_world) {
      depths.push_back(static_cast<float>((pair.database_cam_from_world * point).z()));
    }
    return depths;
  }

  // Calls change(pair) for all pairs.
  template <typename Change>
  void ChangePairs(const Change& change) {
    for (QueryImage& image : scene.group.images) {
      for (ImagePair& pair : image.problem.pairs) change(&pair);
    }
  }

  // num_from_database: tracks whose points database images triangulate.
  void Run(size_t num_from_database = 0) {
    input = MakeStageInput(scene);
    const auto end = input.tracks.begin() + static_cast<std::ptrdiff_t>(num_from_database);
    const StartInput given{{input.tracks, input.tracks},
                           {{input.tracks.begin(), end}, {end, input.tracks.end()}},
                           input.layout.given,
                           {},
                           {}};
    in_use = WithDepthMaps(scene.group, input.layout, Refs(input.pairs), options, given);
  }

  std::vector<DepthMapResult> Results() const {
    std::vector<DepthMapResult> results;
    for (const DepthResult& result : in_use.depths) {
      results.insert(results.end(), result.maps.begin(), result.maps.end());
    }
    return results;
  }

  SyntheticGroup scene;
  LocalizerOptions options;
  StageInput input;
  StartInput in_use;
};

auto HasVerdict(DepthVerdict verdict) { return ::testing::Field(&DepthMapResult::verdict, verdict); }

int CountDepths(const std::vector<Track>& tracks) {
  int num_depths = 0;
  for (const Track& track : tracks) {
    for (const TrackObservation& element : track.observations) num_depths += element.depth > 0;
  }
  return num_depths;
}

void ExpectNoDepths(const MapsInUse& maps) {
  for (const Image& image : maps.in_use.posed.images) EXPECT_FALSE(image.depth_scale);
  for (const auto* tracks : {&maps.in_use.candidates.all, &maps.in_use.candidates.for_start,
                             &maps.in_use.tracks.from_database, &maps.in_use.tracks.rest}) {
    EXPECT_EQ(CountDepths(*tracks), 0);
  }
  EXPECT_THAT(maps.in_use.depth_starts, Each(IsEmpty()));
}

// Expects starts at the true poses for all frames that have any.
void ExpectTrueStarts(const MapsInUse& maps, size_t num_starts) {
  for (size_t frame = 0; frame < maps.in_use.depth_starts.size(); ++frame) {
    EXPECT_EQ(maps.in_use.depth_starts[frame].size(), num_starts);
    for (const Rigid3d& start : maps.in_use.depth_starts[frame]) {
      EXPECT_LE(PositionError(start, maps.input.truth.frames[frame].frame_from_world), 1e-3);
      EXPECT_LE(RotationErrorDeg(start, maps.input.truth.frames[frame].frame_from_world), 1e-3);
    }
  }
}

TEST(DepthMapsInUse, PointsTellTheScaleOfAMap) {
  MapsInUse maps(1, 1);
  maps.ChangePairs([](ImagePair* pair) {
    pair->other_point_depths = pair->other_depths;
    for (float& depth : pair->other_depths) depth /= 2;
  });
  maps.Run();
  ASSERT_EQ(maps.Results().size(), 1u);
  EXPECT_THAT(maps.Results(), Each(HasVerdict(DepthVerdict::USED)));
  EXPECT_NEAR(maps.Results()[0].scale, 2, 1e-5);
  EXPECT_LE(maps.Results()[0].scale_stddev, 0.01);
  EXPECT_EQ(maps.Results()[0].num_points, static_cast<int>(maps.scene.points_in_world.size()));
  const std::optional<DepthScale>& scale = maps.in_use.posed.images[1].depth_scale;
  ASSERT_TRUE(scale);
  EXPECT_NEAR(scale->log_scale, std::log(2), 1e-5);
  EXPECT_EQ(scale->stated_log_scale, scale->log_scale);
  EXPECT_GE(scale->log_depth_stddev, kMinDepthStddev);
  const int num_points = static_cast<int>(maps.input.tracks.size());
  EXPECT_EQ(CountDepths(maps.in_use.candidates.all), num_points);
  EXPECT_EQ(CountDepths(maps.in_use.candidates.for_start), num_points);
  EXPECT_EQ(CountDepths(maps.in_use.tracks.rest), num_points);
  ExpectTrueStarts(maps, 1);
}

TEST(DepthMapsInUse, AMapWithoutScaleIsNotUsed) {
  MapsInUse maps(1, 1);
  maps.Run();
  EXPECT_THAT(maps.Results(), Each(HasVerdict(DepthVerdict::NO_SCALE)));
  ExpectNoDepths(maps);
}

TEST(DepthMapsInUse, AStatementTellsTheScale) {
  MapsInUse maps(1, 1);
  maps.options.depth_is_metric = true;
  maps.Run();
  ASSERT_THAT(maps.Results(), Each(HasVerdict(DepthVerdict::USED)));
  EXPECT_EQ(maps.Results()[0].scale, 1);
  EXPECT_NEAR(maps.Results()[0].scale_stddev, kMetricScaleStddev, 2e-3);
  ExpectTrueStarts(maps, 1);
}

TEST(DepthMapsInUse, ThePairsOwnPointsContradictAWrongMap) {
  MapsInUse maps(1, 1);
  maps.options.depth_is_metric = true;
  maps.ChangePairs([](ImagePair* pair) { std::reverse(pair->other_depths.begin(), pair->other_depths.end()); });
  maps.Run();
  EXPECT_THAT(maps.Results(), Each(HasVerdict(DepthVerdict::CONTRADICTED)));
  ExpectNoDepths(maps);
}

TEST(DepthMapsInUse, PointsContradictAWrongMapWhateverIsStated) {
  for (const bool is_metric : {false, true}) {
    MapsInUse maps(1, 1);
    maps.options.depth_is_metric = is_metric;
    maps.ChangePairs([](ImagePair* pair) {
      pair->other_point_depths = pair->other_depths;
      std::reverse(pair->other_depths.begin(), pair->other_depths.end());
    });
    maps.Run();
    EXPECT_THAT(maps.Results(), Each(HasVerdict(DepthVerdict::CONTRADICTED)));
    ExpectNoDepths(maps);
  }
}

TEST(DepthMapsInUse, TracksThatAdjustmentUsesLeaveTheScaleToIt) {
  MapsInUse maps(3, 1);
  maps.ChangePairs([](ImagePair* pair) {
    for (float& depth : pair->other_depths) depth *= 3;
  });
  maps.Run(/*num_from_database=*/60);
  ASSERT_EQ(maps.Results().size(), 3u);
  for (const DepthMapResult& result : maps.Results()) {
    EXPECT_EQ(result.verdict, DepthVerdict::USED);
    EXPECT_NEAR(result.scale, 1. / 3, 1e-5);
    EXPECT_GE(result.scale_stddev, 1) << "the tracks would count twice";
  }
}

TEST(DepthMapsInUse, UnknownDepthsAreLeftOut) {
  MapsInUse maps(1, 1);
  maps.options.depth_is_metric = true;
  maps.ChangePairs([](ImagePair* pair) { std::fill_n(pair->other_depths.begin(), 50, 0.F); });
  maps.Run();
  EXPECT_THAT(maps.Results(), Each(HasVerdict(DepthVerdict::USED)));
  EXPECT_EQ(CountDepths(maps.in_use.candidates.all), static_cast<int>(maps.input.tracks.size()) - 50);
}

TEST(DepthMapsInUse, AnImageWithoutKnownDepthsIsNotUsed) {
  MapsInUse maps(1, 1);
  maps.options.depth_is_metric = true;
  maps.ChangePairs([](ImagePair* pair) { std::fill(pair->other_depths.begin(), pair->other_depths.end(), 0.F); });
  maps.Run();
  ExpectNoDepths(maps);
}

TEST(DepthMapsInUse, AnImageWithoutAPairInUseIsNotReported) {
  MapsInUse maps(2, 1);
  maps.options.depth_is_metric = true;
  maps.input = MakeStageInput(maps.scene);
  maps.input.pairs.pop_back();
  StartInput given;
  given.posed = maps.input.layout.given;
  const StartInput in_use =
      WithDepthMaps(maps.scene.group, maps.input.layout, Refs(maps.input.pairs), maps.options, given);
  ASSERT_EQ(in_use.depths[0].maps.size(), 1u);
  EXPECT_EQ(in_use.depths[0].maps[0].database_name, maps.scene.group.images[0].problem.pairs[0].other_name);
}

TEST(DepthMapsInUse, ImagesOfARigShareAMap) {
  MapsInUse maps(1, 2);
  maps.options.depth_is_metric = true;
  maps.Run();
  ASSERT_EQ(maps.in_use.depths.size(), 2u);
  for (const DepthResult& result : maps.in_use.depths) {
    ASSERT_EQ(result.maps.size(), 1u) << "each query says what its database images contribute";
    EXPECT_EQ(result.maps[0].verdict, DepthVerdict::USED);
  }
  EXPECT_EQ(CountDepths(maps.in_use.candidates.all), static_cast<int>(maps.input.tracks.size()));
  ExpectTrueStarts(maps, 2);
}

TEST(DepthMapsInUse, EachFrameOfAGroupHasItsStarts) {
  MapsInUse maps(2, 1, /*num_frames=*/3);
  maps.options.depth_is_metric = true;
  maps.Run();
  ASSERT_EQ(maps.in_use.depth_starts.size(), 3u);
  EXPECT_EQ(maps.Results().size(), 6u);
  ExpectTrueStarts(maps, 2);
}

}  // namespace
}  // namespace lazyloc
