// Measures the whole query with the default options; all matches are verified. The counters after the time are the
// times of all stages and of each stage in milliseconds per query. The stages are those of results.jsonl.

#include "query_benchmark.h"

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <benchmark/benchmark.h>

#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/loading/query_source.h"
#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/testing/synthetic_scene.h"

namespace lazyloc {
namespace {

using Problems = std::vector<LocalizationProblem>;

void LocalizeAll(const Problems& problems, benchmark::State& state) {
  std::map<std::string, double> seconds;
  int num_localized = 0;
  for (auto _ : state) {
    for (const LocalizationProblem& problem : problems) {
      const LocalizationResult result = LocalizeQuery(problem, {});
      for (const auto& [stage, stage_seconds] : result.seconds) seconds[stage] += stage_seconds;
      num_localized += result.status == QueryStatus::LOCALIZED;
    }
  }
  const double num_queries = static_cast<double>(problems.size()) * static_cast<double>(state.iterations());
  double total = 0;
  for (const auto& [stage, stage_seconds] : seconds) {
    state.counters[stage] = 1e3 * stage_seconds / num_queries;
    total += stage_seconds;
  }
  state.counters["all_stages"] = 1e3 * total / num_queries;
  state.counters["localized_ratio"] = num_localized / num_queries;
}

// Arguments: number of database images, number of points, which all images observe.
void BM_LocalizeSyntheticQuery(benchmark::State& state) {
  SyntheticSceneOptions options;
  options.num_database_images = static_cast<int>(state.range(0));
  options.num_points = static_cast<int>(state.range(1));
  options.pixel_noise_px = 0.5;
  options.rotation_noise_deg = options.direction_noise_deg = 0.5;
  options.outlier_match_ratio = 0.05;
  LocalizeAll({MakeSyntheticScene(options).problem}, state);
}
BENCHMARK(BM_LocalizeSyntheticQuery)
    ->ArgNames({"images", "points"})
    ->Args({5, 1000})
    ->Args({20, 1000})
    ->Args({20, 4000})
    ->Unit(benchmark::kMillisecond);

}  // namespace

void RegisterQueryBenchmark(const std::filesystem::path& scene_path) {
  SourceOptions options;
  options.database_path = scene_path / "database.db";
  options.input_path = scene_path / "model";
  options.selection.leave_one_out = true;
  const QuerySource source(options, ReadModel(options.input_path), /*seed=*/0, /*num_threads=*/1);
  IdleThreads idle_threads(0);
  QuerySource::Session session(source, &idle_threads);
  const auto problems = std::make_shared<Problems>();
  for (size_t group = 0; group < source.NumGroups(); ++group) {
    LoadedGroup loaded = source.Load(source.Group(group), source.FirstAttempt(), nullptr, &session);
    for (QueryImage& image : loaded.group.images) problems->push_back(std::move(image.problem));
  }
  const std::string label =
      "BM_LocalizeQueries/" + scene_path.filename().string() + "/queries:" + std::to_string(problems->size());
  benchmark::RegisterBenchmark(label.c_str(), [problems](benchmark::State& state) {
    LocalizeAll(*problems, state);
  })->Unit(benchmark::kMillisecond);
}

}  // namespace lazyloc
