// lazyloc_runtime_benchmark [google-benchmark's options] [SCENE...]
//
// Measures each stage and the whole query on synthetic scenes, and the whole query on the real scenes SCENE, which are
// folders with database.db and model/. See docs/benchmarks.md.

#include <cstdlib>
#include <iostream>

#include <benchmark/benchmark.h>

#include "colmap_lazyloc/scene/errors.h"
#include "query_benchmark.h"

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  try {
    for (int i = 1; i < argc; ++i) lazyloc::RegisterQueryBenchmark(argv[i]);
  } catch (const lazyloc::InputError& error) {
    std::cerr << "ERROR: " << error.what() << std::endl;
    return EXIT_FAILURE;
  }
  benchmark::RunSpecifiedBenchmarks();
  return EXIT_SUCCESS;
}
