#include <chrono>
#include <cstdlib>
#include <iostream>

#include "colmap_lazyloc/cli/commands.h"
#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/features/retrieval_index.h"
#include "colmap_lazyloc/options/options.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

int Run(const IndexerOptions& options) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  const DatabaseReader database(options.database_path);
  std::cerr << options.database_path << ": " << EstimateIndex(database, options.retrieval).Text() << std::endl;
  constexpr int kSeed = 0;  // the default of lazy_localizer
  const RetrievalIndex index(options.index_path, database, options.retrieval, kSeed, options.num_threads);
  for (const std::string& warning : index.Warnings()) PrintWarning(warning);
  const RetrievalIndex::Changes& changes = index.LastChanges();
  std::cerr << options.index_path << (changes.is_trained ? ": made" : ": up to date") << ", " << index.NumImages()
            << " images (" << changes.num_added << " added, " << changes.num_removed << " removed) in "
            << std::chrono::duration<double>(Clock::now() - start).count() << " s" << std::endl;
  return EXIT_SUCCESS;
}

}  // namespace

int RunLazyIndexer(int argc, char** argv) {
  return RunCommand("lazy_indexer", [=] {
    IndexerOptions options;
    return ParseCommandLine(argc, argv, &options) ? Run(options) : EXIT_SUCCESS;
  });
}

}  // namespace lazyloc
