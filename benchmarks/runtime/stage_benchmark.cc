// Measures each stage alone on synthetic input. The arguments are the size of the input. Uses one thread and the
// default options.

#include <vector>

#include <benchmark/benchmark.h>

#include "colmap_lazyloc/bridge/observation.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/rotation/rotation_averaging.h"
#include "colmap_lazyloc/structure/track_building.h"
#include "colmap_lazyloc/structure/track_triangulation.h"
#include "colmap_lazyloc/testing/synthetic_pose_graph.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"
#include "colmap_lazyloc/translation/relative_direction.h"
#include "colmap_lazyloc/translation/translation_averaging.h"

namespace lazyloc {
namespace {

constexpr double kNoisePx = 0.5;

// Makes tracks; the query is view 0.
SyntheticTracks MakeTracks(const benchmark::State& state) {
  SyntheticTracksOptions options;
  options.num_database = static_cast<int>(state.range(0));
  options.num_points = static_cast<int>(state.range(1));
  options.noise_px = kNoisePx;
  options.min_views_ratio = 0.3;
  options.focal_length_px = 1000;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  for (View& view : scene.views) view.noise_px = kNoisePx;
  return scene;
}

void DatabaseImagesAndPoints(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"images", "points"})->Args({20, 300})->Args({20, 4000})->Unit(benchmark::kMicrosecond);
}

SyntheticPoseGraph MakePoseGraph(const benchmark::State& state) {
  SyntheticPoseGraphOptions options;
  options.num_database = static_cast<int>(state.range(0));
  options.rotation_noise_deg = options.direction_noise_deg = 0.5;
  options.outlier_edge_ratio = 0.2;
  return MakeSyntheticPoseGraph(options);
}

void BM_AverageRotations(benchmark::State& state) {
  const SyntheticPoseGraph graph = MakePoseGraph(state);
  RotationAveragingProblem problem;
  for (int node = 0; node < graph.NumNodes(); ++node) {
    problem.rotations.push_back(graph.cam_from_world[node].rotation);
    problem.is_fixed.push_back(graph.IsFixed(node));
  }
  for (const SyntheticPoseGraphEdge& edge : graph.edges) {
    problem.edges.push_back({edge.node1, edge.node2, edge.node2_from_node1});
  }
  for (auto _ : state) benchmark::DoNotOptimize(AverageRotations(problem, {}));
}
BENCHMARK(BM_AverageRotations)->ArgName("images")->Arg(5)->Arg(20)->Unit(benchmark::kMicrosecond);

void BM_EstimateRelativeDirection(benchmark::State& state) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  options.num_points = static_cast<int>(state.range(0));
  options.noise_px = kNoisePx;
  options.focal_length_px = 1000;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  std::vector<RayPair> rays;
  for (const Track& track : scene.tracks) {
    const auto ray_in_world = [&](int view) -> Eigen::Vector3d {
      return scene.views[view].cam_from_world.rotation.conjugate() * track.observations[view].observation.ray_in_cam;
    };
    rays.push_back({ray_in_world(1), ray_in_world(0), kNoisePx / options.focal_length_px});
  }
  for (auto _ : state) benchmark::DoNotOptimize(EstimateRelativeDirection(rays));
}
BENCHMARK(BM_EstimateRelativeDirection)->ArgName("matches")->Arg(100)->Arg(1000)->Unit(benchmark::kMicrosecond);

void BM_AverageTranslations(benchmark::State& state) {
  const SyntheticPoseGraph graph = MakePoseGraph(state);
  TranslationAveragingProblem problem;
  for (int node = 0; node < graph.NumNodes(); ++node) {
    problem.cams_in_world.push_back(CamInWorld(graph.cam_from_world[node]));
    problem.is_fixed.push_back(graph.IsFixed(node));
  }
  for (const SyntheticPoseGraphEdge& edge : graph.edges) {
    problem.edges.push_back({edge.node1, edge.node2, edge.dir_1to2_in_world, DegToRad(0.5)});
  }
  for (auto _ : state) benchmark::DoNotOptimize(AverageTranslations(problem, {}));
}
BENCHMARK(BM_AverageTranslations)->ArgName("images")->Arg(5)->Arg(20)->Unit(benchmark::kMicrosecond);

void BM_Observe(benchmark::State& state, const char* model_name, const std::vector<double>& params) {
  Camera camera;
  camera.model_id = *CameraModelId(model_name);
  camera.width = 1280;
  camera.height = 960;
  camera.params = params;
  const Observer observe(camera);
  for (auto _ : state) {
    for (int x = 0; x < 1280; x += 40) benchmark::DoNotOptimize(observe({x + 0.5, 0.75 * x}));
  }
  state.SetItemsProcessed(32 * state.iterations());
}
BENCHMARK_CAPTURE(BM_Observe, PINHOLE, "PINHOLE", {1000, 1000, 640, 480});
BENCHMARK_CAPTURE(BM_Observe, OPENCV, "OPENCV", {1000, 1000, 640, 480, -0.1, 0.02, 1e-3, -1e-3});

void BM_BuildTracks(benchmark::State& state) {
  const SyntheticTracks scene = MakeTracks(state);
  std::vector<ViewMatches> view_matches(scene.views.size() - 1);
  for (size_t i = 0; i < view_matches.size(); ++i) view_matches[i].view = static_cast<int>(i) + 1;
  for (const Track& track : scene.tracks) {
    for (size_t i = 1; i < track.observations.size(); ++i) {
      const TrackObservation &query = track.observations[0], &database = track.observations[i];
      const Match match = {static_cast<uint32_t>(query.keypoint), static_cast<uint32_t>(database.keypoint)};
      view_matches[database.view - 1].Add(match, query.observation, database.observation);
    }
  }
  for (auto _ : state) benchmark::DoNotOptimize(BuildTracks(view_matches));
}
BENCHMARK(BM_BuildTracks)->Apply(DatabaseImagesAndPoints);

void BM_TriangulateFromDatabase(benchmark::State& state) {
  const SyntheticTracks scene = MakeTracks(state);
  std::vector<Track> rest;
  for (auto _ : state) benchmark::DoNotOptimize(TriangulateFromDatabase(scene.views, scene.tracks, {}, &rest));
}
BENCHMARK(BM_TriangulateFromDatabase)->Apply(DatabaseImagesAndPoints);

void BM_TriangulateWithQuery(benchmark::State& state) {
  SyntheticTracks scene = MakeTracks(state);
  for (Track& track : scene.tracks) track.observations.resize(2);
  for (auto _ : state) benchmark::DoNotOptimize(TriangulateWithQuery(scene.views, scene.tracks, {}));
}
BENCHMARK(BM_TriangulateWithQuery)->Apply(DatabaseImagesAndPoints);

void AdjustBundles(const SyntheticTracks& scene, benchmark::State& state) {
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<View> views = scene.views;
    std::vector<Track> tracks = scene.tracks;
    state.ResumeTiming();
    benchmark::DoNotOptimize(AdjustBundle({}, &views, &tracks));
  }
}

// Starts with a query position whose error is a hundredth of its distance from the points.
void BM_AdjustWithConstantDatabase(benchmark::State& state) {
  SyntheticTracks scene = MakeTracks(state);
  scene.views[0].cam_from_world.translation += Eigen::Vector3d(0.05, 0.05, -0.05);
  AdjustBundles(scene, state);
}
BENCHMARK(BM_AdjustWithConstantDatabase)->Apply(DatabaseImagesAndPoints);

void BM_AdjustWithPosePriors(benchmark::State& state) {
  SyntheticTracks scene = MakeTracks(state);
  scene.views[0].cam_from_world.translation += Eigen::Vector3d(0.05, 0.05, -0.05);
  const std::vector<ViewScale> scales = MeasureViewScales(scene.views, scene.tracks);
  for (size_t view = 1; view < scene.views.size(); ++view) {
    scene.views[view].prior = MakePosePrior(scene.views[view].cam_from_world, kNoisePx, scales[view]);
  }
  AdjustBundles(scene, state);
}
BENCHMARK(BM_AdjustWithPosePriors)->Apply(DatabaseImagesAndPoints);

// Measures the steps after adjustment. The covariance for errors of the given size is part of the result of adjustment.
void BM_Covariance(benchmark::State& state) {
  const SyntheticTracks scene = MakeTracks(state);
  const Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
  for (auto _ : state) {
    benchmark::DoNotOptimize(VarianceFactor(scene.views, scene.tracks, BundleAdjustmentOptions().loss_scale_sigma));
    benchmark::DoNotOptimize(ComputePoseSpread(scene.views[0].cam_from_world, covariance));
  }
}
BENCHMARK(BM_Covariance)->Apply(DatabaseImagesAndPoints);

}  // namespace
}  // namespace lazyloc
