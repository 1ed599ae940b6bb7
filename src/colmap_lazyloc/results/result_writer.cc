#include "colmap_lazyloc/results/result_writer.h"

#include <system_error>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/files/paths.h"
#include "colmap_lazyloc/files/staged_output.h"
#include "colmap_lazyloc/formats/localized_results.h"
#include "colmap_lazyloc/results/model_writer.h"
#include "colmap_lazyloc/results/position_files.h"
#include "colmap_lazyloc/results/result_text.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

constexpr char kLeaveOneOutFile[] = "leave_one_out.json";
constexpr char kRigPosesFile[] = "rig_poses.txt";
constexpr char kGeojsonFile[] = "positions.geojson";

void MakeFolder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) throw InputError(path.string() + ": the folder cannot be made: " + error.message());
}

}  // namespace

ResultWriter::ResultWriter(const fs::path& output_path) : output_path_(output_path) {
  std::error_code ignored;
  if (IsTaken(output_path) && !fs::is_directory(output_path, ignored)) {
    throw InputError(output_path.string() + ": is not a folder");
  }
  if (IsTaken(output_path / "model") && !IsTaken(output_path / kResultsFile)) {
    throw InputError((output_path / "model").string() +
                     ": would be replaced, but no earlier run has written it (there is no results.jsonl beside it)");
  }
  for (fs::path folder = output_path; !folder.empty() && !IsTaken(folder); folder = folder.parent_path()) {
    made_folders_.push_back(folder);
  }
  try {
    MakeFolder(output_path);
    // Only tries whether it can be written into, and keeps nothing there that an interrupted run would leave behind.
    const StagedOutput trial(output_path);
  } catch (...) {
    RemoveMadeFolders();
    throw;
  }
}

ResultWriter::~ResultWriter() { RemoveMadeFolders(); }

void ResultWriter::RemoveMadeFolders() noexcept {
  std::error_code ignored;
  // Keeps folders that are not empty: somebody else may have written there since.
  for (const fs::path& folder : made_folders_) fs::remove(folder, ignored);
}

void ResultWriter::Write(const Model& model, const QueryRecords& records, const DatabaseContent& database,
                         const std::string& options_ini, const LeaveOneOutSummary* leave_one_out,
                         const fs::path& staging_parent) {
  StagedOutput staged(output_path_, {}, staging_parent);
  MakeFolder(staged / "model");
  WritePoses(staged / "poses.txt", records);
  WriteResultsJson(staged / kResultsFile, records, model.axes);
  WritePositionsCsv(staged / "positions.csv", records, model.axes);
  WriteModel(staged / "model", staged / "observations", model, records, database);
  OutputFile options_file(staged / "options.ini");
  options_file.Text() << options_ini;
  options_file.Close();
  WriteRigPoses(staged / kRigPosesFile, records);
  if (leave_one_out != nullptr) WriteLeaveOneOut(staged / kLeaveOneOutFile, *leave_one_out);
  if (const auto& origin = model.axes.geographic_origin) {
    WritePositionsGeojson(staged / kGeojsonFile, records, *origin);
  }
  std::vector<std::string> entries = {"poses.txt", kResultsFile, "positions.csv", "options.ini", "model"}, stale;
  for (const char* name : {kRigPosesFile, kLeaveOneOutFile, kGeojsonFile}) {
    (IsTaken(staged / name) ? entries : stale).emplace_back(name);
  }
  staged.Publish(entries);
  std::error_code ignored;
  // Removes what an earlier run has left and this one does not replace.
  for (const std::string& name : stale) fs::remove(output_path_ / name, ignored);
  made_folders_.clear();
}

}  // namespace lazyloc
