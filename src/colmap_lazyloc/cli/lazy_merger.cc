#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <string>
#include <utility>

#include "colmap_lazyloc/cli/commands.h"
#include "colmap_lazyloc/cli/progress.h"
#include "colmap_lazyloc/cli/report_command.h"
#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/cli/run_results.h"
#include "colmap_lazyloc/database/feature_reader.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/options/options.h"
#include "colmap_lazyloc/results/leave_one_out.h"
#include "colmap_lazyloc/runs/shard_folders.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Returns the options of the run that the shards are parts of, with the paths of the merger.
CommandOptions OptionsOfRun(const RunManifest& manifest, const MergerOptions& options) {
  OptionTexts texts = manifest.options;
  for (const auto& [name, input] : manifest.inputs) texts.emplace_back(name, input.path);
  for (const auto& [name, value] : manifest.other_options) {
    // The log and the shard are those of a part of the run.
    if (name != "log_path" && name != "shard") texts.emplace_back(name, value);
  }
  // Leaves options without a value at their defaults, because the parser of the command line takes no empty text.
  texts.erase(std::remove_if(texts.begin(), texts.end(), [](const auto& option) { return option.second.empty(); }),
              texts.end());
  CommandOptions run;
  ParseSettings(texts, &run);
  run.output_path = options.output_path;
  if (!options.database_path.empty()) run.source.database_path = options.database_path;
  if (!options.model_path.empty()) run.source.input_path = options.model_path;
  return run;
}

void CheckInput(const RunManifest& manifest, const std::string& name, const std::string& path,
                const Fingerprint& fingerprint) {
  if (fingerprint.IsChanged(manifest.inputs.at(name).fingerprint)) {
    throw InputError(path + " (--" + name + " of the shards) has changed since they were localized");
  }
}

// Checks that each file has the queries of its shard, because one that is cut off between two records is not damaged.
void CheckNumQueries(const ShardFolders& shards, const QueryRecords& records) {
  const std::vector<size_t> counts = records.CountByFile();
  for (size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == shards.num_queries[i]) continue;
    throw InputError(shards.records[i].string() + ": is truncated: it has " + std::to_string(counts[i]) + " of " +
                     std::to_string(shards.num_queries[i]) + " queries");
  }
}

int Run(const std::string& own_path, const MergerOptions& options) {
  ResultWriter writer(options.output_path);
  const ShardFolders shards = FindShards(options.input_path);
  const RunManifest& manifest = shards.manifest;
  const CommandOptions run = OptionsOfRun(manifest, options);
  Model model = ReadModel(run.source.input_path);
  CheckInput(manifest, "input_path", run.source.input_path, FingerprintOf(model));
  CheckInput(manifest, "database_path", run.source.database_path, FingerprintOf(run.source.database_path));
  const DatabaseReader database(run.source.database_path);

  const QueryRecords records(shards.records);
  CheckNumQueries(shards, records);
  if (!run.source.selection.leave_one_out) {
    const auto is_query = [&](const ModelImage& image) { return records.Find(image.name).has_value(); };
    model.images.erase(std::remove_if(model.images.begin(), model.images.end(), is_query), model.images.end());
  }
  const std::vector<DatabaseImage> images = database.ReadImages();
  DatabaseContent content = {database, images};
  const DescriptorCounts counts = FeatureReader(run.source.database_path).Counts();
  if (!counts.of_image.empty() && !IsAliked(counts.type)) {  // fallback features are ALIKED's
    content.was_matched_with_them = [](const QueryRecord& record) {
      return !record.matcher || record.matcher == MatcherType::SIFT_BRUTEFORCE;
    };
  }
  const auto leave_one_out = WriteResults(run, manifest, model, content, records, {}, /*staging_parent=*/{}, &writer);
  Progress({records.Size(), records.Size(), 0}, /*log_path=*/{}, /*append_log=*/false).PrintSummary(records);
  if (leave_one_out) std::cerr << FormatLeaveOneOut(*leave_one_out);
  PrintReportCommand(own_path, run);
  return EXIT_SUCCESS;
}

}  // namespace

int RunLazyMerger(int argc, char** argv) {
  return RunCommand("lazy_merger", [=] {
    MergerOptions options;
    return ParseCommandLine(argc, argv, &options) ? Run(argv[0], options) : EXIT_SUCCESS;
  });
}

}  // namespace lazyloc
