#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/cli/commands.h"
#include "colmap_lazyloc/cli/progress.h"
#include "colmap_lazyloc/cli/report_command.h"
#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/cli/run_results.h"
#include "colmap_lazyloc/formats/localized_results.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/localizer/localizer.h"
#include "colmap_lazyloc/options/options.h"
#include "colmap_lazyloc/results/leave_one_out.h"
#include "colmap_lazyloc/runs/unfinished_run.h"
#include "colmap_lazyloc/scene/format.h"

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace lazyloc {
namespace {

constexpr int kExitNotAllLocalized = 2;
constexpr int kExitSignal = 128;  // plus the number of the signal, as shells count

volatile std::sig_atomic_t interrupted = 0;  // number of the signal

// Ends the run in order after the first Ctrl-C or SIGTERM; a second one ends the program at once.
void HandleInterrupt(int signal) {
  interrupted = signal;
  std::signal(signal, SIG_DFL);
}

void HandleInterruptsBy(void (*handler)(int)) {
  std::signal(SIGINT, handler);
  std::signal(SIGTERM, handler);
}

// Keeps freed memory for the next query instead of returning it to the system, which saves a tenth of the time because
// each query allocates and frees a few megabytes.
void KeepFreedMemory() {
#ifdef __GLIBC__
  mallopt(M_TRIM_THRESHOLD, 64 << 20);
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
#endif
}

// True if the folder has this shard, finished, which a job that is started again need not do again.
bool IsFinishedShard(const CommandOptions& options, const RunManifest& manifest) {
  const std::optional<RunManifest> finished = UnfinishedRun::FinishedShard(options.output_path);
  if (!finished || !manifest.shard || finished->shard->Text() != manifest.shard->Text()) return false;
  if (!manifest.ChangeSince(*finished).empty()) return false;
  std::cerr << options.output_path << ": shard " << manifest.shard->Text() << " is finished" << std::endl;
  return true;
}

// Warns early of results of other queries in the output folder, because this run replaces them.
void WarnOfReplacedResults(const std::string& output_path, const QuerySource& source,
                           const std::vector<size_t>& groups) {
  const std::filesystem::path path = std::filesystem::path(output_path) / kResultsFile;
  std::set<std::string> names = ReadNamesOfResults(path);
  for (const size_t group : groups) {
    for (const QueryFrame& frame : source.Selection().Groups().At(group)) {
      for (const QueryFrame::Image& image : frame.images) names.erase(ValidUtf8(image.name));
    }
  }
  if (names.empty()) return;
  const std::string count = names.size() == 1 ? "1 other query" : std::to_string(names.size()) + " other queries";
  PrintWarning(path.string() + ": this run replaces the results of " + count);
}

// Localizes the queries that are not done, one group per task. Begins no new group if it is interrupted.
void LocalizeRest(const Localizer& localizer, std::vector<size_t> groups, IdleThreads* idle_threads, UnfinishedRun* run,
                  Progress* progress) {
  const QuerySource& source = *localizer.Source();
  groups.erase(std::remove_if(groups.begin(), groups.end(), [&](size_t group) { return run->IsDone(group); }),
               groups.end());
  interrupted = 0;
  HandleInterruptsBy(HandleInterrupt);
  std::mutex finish_mutex;
  const auto localize = [&](size_t index) {
    if (interrupted != 0) return;
    const std::vector<QueryRecord> records = localizer.Localize(source.Group(groups[index]));
    const std::lock_guard<std::mutex> lock(finish_mutex);
    run->Append(groups[index], records);
    for (const QueryRecord& record : records) progress->Report(record);
  };
  ParallelFor(groups.size(), localize, idle_threads);
  run->Sync();
  if (source.Depths() == nullptr) return;
  for (const std::string& problem : source.Depths()->Problems()) PrintWarning(problem);
  const std::string missing = source.Depths()->MissingMaps();
  if (!missing.empty()) PrintWarning(missing);
}

// Estimates the cameras that queries share, and prints them.
SharedCameras ShareCameras(const Localizer& localizer, bool is_asked_for) {
  SharedCameras cameras = localizer.EstimateCameras();
  for (const SharedCamera& shared : cameras) std::cerr << DescribeCamera(shared) << std::endl;
  if (is_asked_for && cameras.empty()) {
    PrintWarning("--ImageReader.single_camera: no camera could be estimated from two queries");
  }
  return cameras;
}

int Run(const std::string& own_path, const CommandOptions& options) {
  UnfinishedRun::CheckStart(options.output_path, options.Start());
  ResultWriter writer(options.output_path);
  Model model = ReadModel(options.source.input_path);
  const Fingerprint model_fingerprint = FingerprintOf(model);
  IdleThreads idle_threads(EffectiveNumThreads(options.num_threads) - 1);
  const Localizer localizer(options.source, options.localizer, std::move(model), options.num_threads, &idle_threads);
  const QuerySource& source = *localizer.Source();
  const std::vector<std::string> warnings = source.Warnings();
  for (const std::string& warning : warnings) PrintWarning(warning);
  KeepFreedMemory();
  const std::vector<size_t> groups = GroupsOfShard(source, ParseShard(options.shard));
  const RunManifest manifest = MakeManifest(options, source, model_fingerprint, groups);
  if (options.resume && IsFinishedShard(options, manifest)) return EXIT_SUCCESS;
  WarnOfReplacedResults(options.output_path, source, groups);
  if (!manifest.extraction.empty()) std::cerr << manifest.extraction << std::endl;
  UnfinishedRun run(options.output_path, manifest, options.Start());
  const RunSize size = {manifest.num_own_queries, run.NumQueriesDone(),
                        manifest.num_queries - manifest.num_own_queries};
  const SharedCameras shared_cameras = ShareCameras(localizer, options.source.single_camera);
  Progress progress(size, options.log_path, options.resume);
  LocalizeRest(localizer, groups, &idle_threads, &run, &progress);
  const std::vector<std::string> later_warnings = source.Warnings();  // of an index that was made meanwhile
  for (size_t i = warnings.size(); i < later_warnings.size(); ++i) PrintWarning(later_warnings[i]);

  const QueryRecords records({run.RecordsPath()});
  DatabaseContent database = {source.Database(), source.Selection().DatabaseImages()};
  database.was_matched_with_them = [&](const QueryRecord& record) { return source.HasStoredKeypoints(record); };
  if (options.source.photos.on_demand) {
    database.extracted_keypoints = [&](const std::string& name) { return source.ExtractedKeypoints(name); };
  }
  const auto leave_one_out =
      WriteResults(options, manifest, source.DatabaseModel(), database, records, shared_cameras, run.Folder(), &writer);
  source.PublishMatches();
  const bool is_finished = records.Size() == manifest.num_own_queries;
  if (is_finished) run.Finish();
  HandleInterruptsBy(SIG_DFL);
  const bool all_localized = progress.PrintSummary(records);
  if (leave_one_out) std::cerr << FormatLeaveOneOut(*leave_one_out);
  PrintReportCommand(own_path, options);
  if (!is_finished) {
    std::cerr << "partial: to continue, run the same command with --resume 1" << std::endl;
    return kExitSignal + interrupted;
  }
  return options.strict && !all_localized ? kExitNotAllLocalized : EXIT_SUCCESS;
}

}  // namespace

int RunLazyLocalizer(int argc, char** argv) {
  return RunCommand("lazy_localizer", [=] {
    CommandOptions options;
    return ParseCommandLine(argc, argv, &options) ? Run(argv[0], options) : EXIT_SUCCESS;
  });
}

}  // namespace lazyloc
