#include "colmap_lazyloc/cli/lazy_localizer.h"

#include <csignal>
#include <cstdlib>
#include <iostream>

#include "colmap_lazyloc/cli/options.h"
#include "colmap_lazyloc/cli/progress.h"
#include "colmap_lazyloc/cli/query_runner.h"
#include "colmap_lazyloc/io/model_reader.h"
#include "colmap_lazyloc/io/result_writer.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr int kExitNotAllLocalized = 2;
constexpr int kExitInterrupted = 130;

volatile std::sig_atomic_t interrupted = 0;

// The first Ctrl-C ends the run in order, the second one at once.
void HandleInterrupt(int) {
  interrupted = 1;
  std::signal(SIGINT, SIG_DFL);
}

bool AllLocalized(const std::vector<LocalizationResult>& results) {
  for (const LocalizationResult& result : results) {
    if (result.status != QueryStatus::LOCALIZED) return false;
  }
  return true;
}

ProblemLoader MakeLoader(const CommandOptions& options, const DatabaseReader& database) {
  Model model = ReadModel(options.input_path);
  std::vector<QueryListEntry> queries;
  if (!options.query_list_path.empty()) queries = ReadQueryList(options.query_list_path);
  return ProblemLoader(database, std::move(model), queries, options.pairs_path, options.loader);
}

int Run(const CommandOptions& options) {
  const DatabaseReader database(options.database_path);
  const ProblemLoader loader = MakeLoader(options, database);
  ResultWriter writer(options.output_path);
  if (!loader.Warning().empty()) std::cerr << "WARNING: " << loader.Warning() << std::endl;
  interrupted = 0;
  std::signal(SIGINT, HandleInterrupt);
  Progress progress(loader.QueryNames().size());
  const std::vector<LocalizationResult> results = RunQueries(
      loader, options.database_path, options.localizer, options.num_threads,
      [&](const LocalizationResult& result) { progress.Report(result); }, [] { return interrupted != 0; });
  std::signal(SIGINT, SIG_DFL);
  writer.Write(loader.DatabaseModel(), results, database, OptionsAsIni(options));
  progress.PrintSummary(results);
  if (interrupted != 0) return kExitInterrupted;
  return options.strict && !AllLocalized(results) ? kExitNotAllLocalized : EXIT_SUCCESS;
}

}  // namespace

int RunLazyLocalizer(int argc, char** argv) {
  try {
    CommandOptions options;
    if (!ParseCommandLine(argc, argv, &options)) return EXIT_SUCCESS;
    return Run(options);
  } catch (const InputError& error) {
    std::cerr << "ERROR: " << error.what() << std::endl;
  } catch (const std::exception& error) {
    std::cerr << "ERROR (a bug in lazy_localizer, please report it): " << error.what() << std::endl;
  }
  return EXIT_FAILURE;
}

}  // namespace lazyloc
