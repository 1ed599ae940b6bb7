#include "colmap_lazyloc/cli/lazy_localizer.h"

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <set>
#include <string>

#include "colmap_lazyloc/cli/options.h"
#include "colmap_lazyloc/cli/progress.h"
#include "colmap_lazyloc/cli/query_runner.h"
#include "colmap_lazyloc/cli/report_command.h"
#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/io/query_source.h"
#include "colmap_lazyloc/io/result_writer.h"

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace lazyloc {
namespace {

constexpr int kExitNotAllLocalized = 2;
constexpr int kExitInterrupted = 130;

volatile std::sig_atomic_t interrupted = 0;

// Ends the run in order after the first Ctrl-C; a second one ends the program at once.
void HandleInterrupt(int) {
  interrupted = 1;
  std::signal(SIGINT, SIG_DFL);
}

// Keeps freed memory for the next query instead of returning it to the system, which saves a tenth of the time because
// each query allocates and frees a few megabytes.
void KeepFreedMemory() {
#ifdef __GLIBC__
  mallopt(M_TRIM_THRESHOLD, 64 << 20);
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
#endif
}

bool AllLocalized(const std::vector<QueryRecord>& records) {
  return std::all_of(records.begin(), records.end(),
                     [](const QueryRecord& record) { return record.result.status == QueryStatus::LOCALIZED; });
}

// Warns of localized queries whose intrinsics the images contradict.
void WarnOfIntrinsics(const std::vector<QueryRecord>& records) {
  for (const QueryRecord& record : records) {
    const LocalizationResult& result = record.result;
    if (result.status != QueryStatus::LOCALIZED || result.intrinsics.contradiction.empty()) continue;
    PrintWarning("query " + result.query_name + ": " + result.intrinsics.contradiction);
  }
}

// Warns once of the depth maps that were not used.
void WarnOfDepthMaps(const std::vector<QueryRecord>& records) {
  std::set<std::string> contradicted, without_scale;
  for (const QueryRecord& record : records) {
    if (!record.result.depth) continue;
    for (const DepthMapResult& map : record.result.depth->maps) {
      if (map.verdict == DepthVerdict::CONTRADICTED) contradicted.insert(map.database_name);
      if (map.verdict == DepthVerdict::NO_SCALE) without_scale.insert(map.database_name);
    }
  }
  const auto warn = [](const std::set<std::string>& names, const std::string& reason) {
    if (names.empty()) return;
    PrintWarning("depth maps left out for " + std::to_string(names.size()) + " database images (for example " +
                 *names.begin() + "): " + reason);
  };
  warn(contradicted, "triangulated points contradict them");
  warn(without_scale, "too few triangulated points tell their scale, and --LazyLocalizer.depth_is_metric is 0");
}

int Run(const CommandOptions& options) {
  ResultWriter writer(options.output_path);
  const std::unique_ptr<const QuerySource> source_of_options = MakeQuerySource(options);
  const QuerySource& source = *source_of_options;
  for (const std::string& warning : source.Warnings()) PrintWarning(warning);
  KeepFreedMemory();
  interrupted = 0;
  std::signal(SIGINT, HandleInterrupt);
  Progress progress(source.NumQueries());
  const std::vector<QueryRecord> records = RunQueries(
      source, options.localizer, options.num_threads, [&](const QueryRecord& record) { progress.Report(record); },
      [] { return interrupted != 0; });
  std::signal(SIGINT, SIG_DFL);
  WarnOfIntrinsics(records);
  for (const std::string& warning : source.DepthWarnings()) PrintWarning(warning);
  WarnOfDepthMaps(records);
  const bool is_leave_one_out = options.source.selection.leave_one_out;
  const std::string options_ini = "# written by " + ProgramVersion() + "\n" + OptionsAsIni(options);
  writer.Write(source.DatabaseModel(), records, source.Database(), options_ini, is_leave_one_out);
  source.PublishMatches();
  progress.PrintSummary(records);
  if (is_leave_one_out) progress.PrintLeaveOneOut(source.DatabaseModel(), records);
  std::cout << "report: " << ReportCommand(options) << std::endl;
  if (interrupted != 0) return kExitInterrupted;
  return options.strict && !AllLocalized(records) ? kExitNotAllLocalized : EXIT_SUCCESS;
}

}  // namespace

int RunLazyLocalizer(int argc, char** argv) {
  return RunCommand("lazy_localizer", [=] {
    CommandOptions options;
    return ParseCommandLine(argc, argv, &options) ? Run(options) : EXIT_SUCCESS;
  });
}

}  // namespace lazyloc
