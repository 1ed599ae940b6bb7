// Measures each stage alone on synthetic input. The arguments are the size of the input. Uses one thread and the
// default options.

#include <algorithm>
#include <utility>
#include <vector>

#include <benchmark/benchmark.h>

#include "colmap_lazyloc/bridge/observer.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/ceres_bundle_adjustment.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/refinement/robust_loss.h"
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

// Makes tracks of a query, image 0, and database images.
SyntheticTracks MakeTracks(const benchmark::State& state) {
  SyntheticTracksOptions options;
  options.num_database = static_cast<int>(state.range(0));
  options.num_points = static_cast<int>(state.range(1));
  options.noise_px = kNoisePx;
  options.min_images_ratio = 0.3;
  options.focal_length_px = 1000;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  for (Image& image : scene.posed.images) image.noise_px = kNoisePx;
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
  for (auto _ : state) benchmark::DoNotOptimize(AverageRotations(problem));
}
BENCHMARK(BM_AverageRotations)->ArgName("images")->Arg(5)->Arg(20)->Unit(benchmark::kMicrosecond);

void BM_EstimateRelativeDirection(benchmark::State& state) {
  SyntheticTracksOptions options;
  options.num_database = 1;
  options.num_points = static_cast<int>(state.range(0));
  options.noise_px = kNoisePx;
  options.focal_length_px = 1000;
  const SyntheticTracks scene = MakeSyntheticTracks(options);
  std::vector<RayMatch> rays;
  for (const Track& track : scene.tracks) {
    const auto ray_in_world = [&](int image) -> Eigen::Vector3d {
      return CamFromWorld(scene.posed, image).rotation.conjugate() * track.observations[image].observation.ray_in_cam;
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
  for (auto _ : state) benchmark::DoNotOptimize(AverageTranslations(problem));
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
  std::vector<PairGeometry> pairs(scene.posed.images.size() - 1);
  PairRefs refs;
  for (size_t i = 0; i < pairs.size(); ++i) {
    pairs[i].query = 0;
    pairs[i].other = static_cast<int>(i) + 1;
    refs.push_back(&pairs[i]);
  }
  for (const Track& track : scene.tracks) {
    for (size_t i = 1; i < track.observations.size(); ++i) {
      const TrackObservation &query = track.observations[0], &database = track.observations[i];
      const Match match = {static_cast<uint32_t>(query.keypoint), static_cast<uint32_t>(database.keypoint)};
      pairs[database.image - 1].inliers.push_back({match, query.observation, database.observation});
    }
  }
  for (auto _ : state) benchmark::DoNotOptimize(BuildTracks(refs));
}
BENCHMARK(BM_BuildTracks)->Apply(DatabaseImagesAndPoints);

void BM_TriangulateFromDatabase(benchmark::State& state) {
  const SyntheticTracks scene = MakeTracks(state);
  for (auto _ : state) benchmark::DoNotOptimize(TriangulateFromDatabase(scene.posed, scene.tracks, {}));
}
BENCHMARK(BM_TriangulateFromDatabase)->Apply(DatabaseImagesAndPoints);

void BM_TriangulateWithQuery(benchmark::State& state) {
  SyntheticTracks scene = MakeTracks(state);
  for (Track& track : scene.tracks) track.observations.resize(2);
  for (auto _ : state) benchmark::DoNotOptimize(TriangulateWithQuery(scene.posed, scene.tracks, {}));
}
BENCHMARK(BM_TriangulateWithQuery)->Apply(DatabaseImagesAndPoints);

void AdjustBundles(const SyntheticTracks& scene, benchmark::State& state) {
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<Track> tracks = scene.tracks;
    state.ResumeTiming();
    benchmark::DoNotOptimize(AdjustBundle(scene.posed, std::move(tracks), {}));
  }
}

// Takes as many steps as AdjustBundle. Leaves out the covariances, which AdjustBundle computes.
void AdjustBundlesWithCeres(const SyntheticTracks& scene, bool solves_sparsely, benchmark::State& state) {
  CeresOptions options;
  options.max_num_iterations = AdjustBundle(scene.posed, scene.tracks, {}).summary.iterations + 1;
  options.function_tolerance = 1e-16;
  options.solves_sparsely = solves_sparsely;
  for (auto _ : state) benchmark::DoNotOptimize(AdjustWithCeres(scene.posed, scene.tracks, options));
}

// Makes tracks of a query whose position has an error of a hundredth of its distance from the points.
SyntheticTracks MakeTracksToAdjust(const benchmark::State& state) {
  SyntheticTracks scene = MakeTracks(state);
  scene.posed.frames[0].frame_from_world.translation += Eigen::Vector3d(0.05, 0.05, -0.05);
  return scene;
}

SyntheticTracks WithPriors(SyntheticTracks scene) {
  const std::vector<FrameScale> scales = MeasureFrameScales(scene.posed, scene.tracks);
  for (size_t i = 0; i < scene.posed.frames.size(); ++i) {
    Frame& frame = scene.posed.frames[i];
    if (frame.is_database) frame.prior = MakePosePrior(frame.frame_from_world, kNoisePx, scales[i]);
  }
  return scene;
}

void BM_AdjustWithConstantDatabase(benchmark::State& state) { AdjustBundles(MakeTracksToAdjust(state), state); }
BENCHMARK(BM_AdjustWithConstantDatabase)->Apply(DatabaseImagesAndPoints);

void BM_CeresAdjustWithConstantDatabase(benchmark::State& state) {
  AdjustBundlesWithCeres(MakeTracksToAdjust(state), false, state);
}
BENCHMARK(BM_CeresAdjustWithConstantDatabase)->Apply(DatabaseImagesAndPoints);

void BM_AdjustWithPosePriors(benchmark::State& state) { AdjustBundles(WithPriors(MakeTracksToAdjust(state)), state); }
BENCHMARK(BM_AdjustWithPosePriors)->Apply(DatabaseImagesAndPoints);

void BM_CeresAdjustWithPosePriors(benchmark::State& state) {
  AdjustBundlesWithCeres(WithPriors(MakeTracksToAdjust(state)), false, state);
}
BENCHMARK(BM_CeresAdjustWithPosePriors)->Apply(DatabaseImagesAndPoints);

// Makes frames along a path; every third is a database frame with a prior. In front of each are 50 points, which the
// four frames before and the four after it observe too.
SyntheticTracks MakePath(const benchmark::State& state) {
  constexpr int kNumNeighbours = 4, kNumPointsPerFrame = 50;
  SyntheticTracks scene;
  Random random(1);
  const int num_frames = static_cast<int>(state.range(0));
  for (int i = 0; i < num_frames; ++i) {
    Frame frame;
    frame.is_database = i % 3 == 0;
    frame.frame_from_world = LookAt({0.5 * i, 0, -8}, Eigen::Vector3d(0.5 * i, 0, 0) + 0.3 * RandomVector(&random));
    Image image;
    image.frame = i;
    image.noise_px = kNoisePx;
    scene.posed.frames.push_back(frame);
    scene.posed.images.push_back(image);
  }
  for (int i = 0; i < num_frames * kNumPointsPerFrame; ++i) {
    const int middle = i % num_frames;
    Track track;
    track.point_in_world = Eigen::Vector3d(0.5 * middle, 0, 0) + RandomVector(&random);
    for (int image = std::max(0, middle - kNumNeighbours); image <= std::min(num_frames - 1, middle + kNumNeighbours);
         ++image) {
      const Eigen::Vector2d offset_px = kNoisePx * RandomVector(&random).head<2>();
      const Eigen::Vector3d point_in_cam = CamFromWorld(scene.posed, image) * track.point_in_world;
      track.observations.push_back({image, i, ObserveAt(point_in_cam, 1000, offset_px)});
    }
    scene.tracks.push_back(std::move(track));
  }
  scene = WithPriors(std::move(scene));
  DisturbQueries(&scene, 0.1, 0.02, 0.02);
  return scene;
}

void BM_AdjustPath(benchmark::State& state) { AdjustBundles(MakePath(state), state); }
BENCHMARK(BM_AdjustPath)->ArgName("frames")->Arg(500)->Arg(2000)->Unit(benchmark::kMillisecond);

void BM_CeresAdjustPath(benchmark::State& state) { AdjustBundlesWithCeres(MakePath(state), true, state); }
BENCHMARK(BM_CeresAdjustPath)->ArgName("frames")->Arg(500)->Arg(2000)->Unit(benchmark::kMillisecond);

// Measures the steps after adjustment. The covariance for errors of the given size is part of the result of adjustment.
void BM_Covariance(benchmark::State& state) {
  const SyntheticTracks scene = MakeTracks(state);
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        VarianceFactor(scene.posed, scene.tracks, RobustLoss(BundleAdjustmentOptions().loss_scale_sigma)));
  }
}
BENCHMARK(BM_Covariance)->Apply(DatabaseImagesAndPoints);

}  // namespace
}  // namespace lazyloc
