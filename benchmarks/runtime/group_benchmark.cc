// Localizes groups of queries along a path, like the images of a video, together and one by one. Each counter after the
// time is the time of a stage in milliseconds per query.

#include <map>
#include <string>

#include <benchmark/benchmark.h>

#include "colmap_lazyloc/pipeline/lazy_localizer.h"
#include "colmap_lazyloc/testing/synthetic_video.h"

namespace lazyloc {
namespace {

void LocalizeVideo(benchmark::State& state, bool is_joint) {
  SyntheticVideoOptions options;
  options.num_queries = static_cast<int>(state.range(0));
  const SyntheticGroup video = MakeSyntheticVideo(options);
  std::map<std::string, double> seconds;
  int num_localized = 0;
  const auto add = [&](const LocalizationResult& result) {
    for (const auto& [stage, stage_seconds] : result.seconds) seconds[stage] += stage_seconds;
    num_localized += result.status == QueryStatus::LOCALIZED;
  };
  for (auto _ : state) {
    if (is_joint) {
      for (const LocalizationResult& result : LocalizeGroup(video.group, {})) add(result);
    } else {
      for (const QueryImage& image : video.group.images) add(LocalizeQuery(image.problem, {}));
    }
  }
  const double num_queries = static_cast<double>(options.num_queries) * static_cast<double>(state.iterations());
  for (const auto& [stage, stage_seconds] : seconds) state.counters[stage] = 1e3 * stage_seconds / num_queries;
  state.counters["localized_ratio"] = num_localized / num_queries;
}

void Sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgName("queries")->Arg(1)->Arg(10)->Arg(100)->Arg(1000)->Unit(benchmark::kMillisecond);
}
BENCHMARK_CAPTURE(LocalizeVideo, alone, false)->Apply(Sizes);
BENCHMARK_CAPTURE(LocalizeVideo, joint, true)->Apply(Sizes);

}  // namespace
}  // namespace lazyloc
