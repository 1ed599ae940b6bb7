#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <set>
#include <string>

#include "colmap_lazyloc/cli/commands.h"
#include "colmap_lazyloc/cli/progress.h"
#include "colmap_lazyloc/cli/report_command.h"
#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/epoch/epoch.h"
#include "colmap_lazyloc/files/staged_output.h"
#include "colmap_lazyloc/formats/control_point_file.h"
#include "colmap_lazyloc/formats/localized_results.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/options/options.h"
#include "colmap_lazyloc/results/result_writer.h"
#include "colmap_lazyloc/runs/record_bytes.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

// Returns the options in which a report finds what the results were made of.
CommandOptions AsCommandOptions(const EpochCommandOptions& options) {
  CommandOptions command;
  command.source.database_path = options.database_path;
  command.source.input_path = options.input_path;
  command.output_path = options.output_path;
  command.num_threads = options.epoch.num_threads;
  command.localizer.min_confidence = options.epoch.min_confidence;
  return command;
}

// Returns the database images: those of the model that are not new photos.
Model ReadDatabaseModel(const std::string& path, const std::vector<LocalizationResult>& localized) {
  Model model = ReadModel(path);
  std::set<std::string> names;
  for (const LocalizationResult& result : localized) names.insert(result.query_name);
  const auto is_photo = [&](const ModelImage& image) { return names.count(image.name) > 0; };
  model.images.erase(std::remove_if(model.images.begin(), model.images.end(), is_photo), model.images.end());
  if (model.images.empty()) throw InputError(path + ": all images are new photos");
  return model;
}

// Reads the control points, if a file of them is given.
std::vector<ControlPoint> ReadControl(const std::string& path, const Model& model,
                                      const std::vector<LocalizationResult>& localized) {
  if (path.empty()) return {};
  std::set<std::string> names;
  for (const ModelImage& image : model.images) names.insert(image.name);
  for (const LocalizationResult& result : localized) names.insert(result.query_name);
  return ReadControlPoints(path, [&](const std::string& name) { return names.count(name) > 0; });
}

int Run(const std::string& own_path, const EpochCommandOptions& options) {
  if (fs::weakly_canonical(options.output_path) == fs::weakly_canonical(options.localized_path)) {
    throw InputError("--output_path " + options.output_path + ": is also --localized_path");
  }
  const std::vector<LocalizationResult> localized = ReadLocalizedResults(options.localized_path);
  Model model = ReadDatabaseModel(options.input_path, localized);
  const std::vector<ControlPoint> control = ReadControl(options.control_points_path, model, localized);
  const DatabaseReader database(options.database_path);
  const auto is_localized = [](const LocalizationResult& result) { return result.status == QueryStatus::LOCALIZED; };
  if (std::none_of(localized.begin(), localized.end(), is_localized)) {
    throw InputError(options.localized_path + ": no photo is localized");
  }
  ResultWriter writer(options.output_path);
  const StagedOutput scratch(options.output_path);
  const std::vector<QueryRecord> adjusted =
      AdjustEpoch(model, localized, control, database, options.epoch, scratch / "photos.txt",
                  [](const std::string& line) { std::cerr << line << std::endl; });
  RecordWriter(scratch / "records.bin").Append(PackGroup(0, adjusted));
  const QueryRecords records({scratch / "records.bin"});
  if (!options.with_database) {
    model.images.clear();
    model.cameras.clear();
    model.rigs.clear();
    model.frames.clear();
  }
  const CommandOptions command = AsCommandOptions(options);
  writer.Write(model, records, {database, database.ReadImages()},
               "# written by " + ProgramVersion() + ", lazy_epoch\n" + OptionsAsIni(command), nullptr);
  Progress({records.Size(), records.Size(), 0}, /*log_path=*/{}, /*append_log=*/false).PrintSummary(records);
  PrintReportCommand(own_path, command);
  return EXIT_SUCCESS;
}

}  // namespace

int RunLazyEpoch(int argc, char** argv) {
  return RunCommand("lazy_epoch", [=] {
    EpochCommandOptions options;
    return ParseCommandLine(argc, argv, &options) ? Run(argv[0], options) : EXIT_SUCCESS;
  });
}

}  // namespace lazyloc
