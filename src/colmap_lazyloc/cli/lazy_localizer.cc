#include "colmap_lazyloc/cli/lazy_localizer.h"

#include <csignal>
#include <cstdlib>
#include <iostream>
#include <memory>

#include "colmap_lazyloc/cli/options.h"
#include "colmap_lazyloc/cli/progress.h"
#include "colmap_lazyloc/cli/query_runner.h"
#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/io/model_reader.h"
#include "colmap_lazyloc/io/result_writer.h"
#include "colmap_lazyloc/scene/errors.h"

#ifdef __GLIBC__
#include <malloc.h>
#endif

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

// Each query takes a few megabytes and frees them: kept for the next one, and not given back to the system, they save a
// tenth of the time.
void KeepFreedMemory() {
#ifdef __GLIBC__
  mallopt(M_TRIM_THRESHOLD, 64 << 20);
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
#endif
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

std::unique_ptr<PhotoLoader> MakePhotoLoader(const CommandOptions& options, const DatabaseReader& database,
                                             const ProblemLoader& loader) {
  if (loader.Photos().empty()) return nullptr;
  PairMatchingOptions pair_options;
  pair_options.matching = options.photos.matching.matching;
  pair_options.verification.min_num_inliers = options.localizer.relative_pose.min_num_inliers;
  pair_options.verification.max_error_px = options.localizer.relative_pose.max_two_view_error_px;
  pair_options.seed = options.localizer.seed;
  return std::make_unique<PhotoLoader>(database, loader.DatabaseModel(), loader.Photos(), options.loader.num_retrieved,
                                       pair_options, options.photos);
}

std::unique_ptr<MatchesOutput> MakeMatchesOutput(const CommandOptions& options, const DatabaseReader& database,
                                                 const ProblemLoader& loader) {
  if (options.matches_output_path.empty()) return nullptr;
  std::vector<std::string> names;
  for (const auto& [name, photo] : loader.Photos()) names.push_back(name);
  return std::make_unique<MatchesOutput>(options.matches_output_path, database, names);
}

int Run(const CommandOptions& options) {
  const DatabaseReader database(options.database_path);
  const ProblemLoader loader = MakeLoader(options, database);
  ResultWriter writer(options.output_path);
  for (const std::string& warning : loader.Warnings()) std::cerr << "WARNING: " << warning << std::endl;
  const std::unique_ptr<MatchesOutput> matches_output = MakeMatchesOutput(options, database, loader);
  const std::unique_ptr<PhotoLoader> photo_loader = MakePhotoLoader(options, database, loader);
  KeepFreedMemory();
  interrupted = 0;
  std::signal(SIGINT, HandleInterrupt);
  Progress progress(loader.QueryNames().size());
  const std::vector<LocalizationResult> results = RunQueries(
      {&loader, photo_loader.get(), matches_output.get()}, options.database_path, options.localizer,
      options.num_threads, [&](const LocalizationResult& result) { progress.Report(result); },
      [] { return interrupted != 0; });
  std::signal(SIGINT, SIG_DFL);
  writer.Write(loader.DatabaseModel(), results, database, OptionsAsIni(options));
  if (matches_output) matches_output->Publish();
  progress.PrintSummary(results);
  if (interrupted != 0) return kExitInterrupted;
  return options.strict && !AllLocalized(results) ? kExitNotAllLocalized : EXIT_SUCCESS;
}

}  // namespace

int RunLazyLocalizer(int argc, char** argv) {
  return RunCommand("lazy_localizer", [=] {
    CommandOptions options;
    return ParseCommandLine(argc, argv, &options) ? Run(options) : EXIT_SUCCESS;
  });
}

}  // namespace lazyloc
