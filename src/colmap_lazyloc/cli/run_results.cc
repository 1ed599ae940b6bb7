#include "colmap_lazyloc/cli/run_results.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/cli/report_command.h"
#include "colmap_lazyloc/cli/run_command.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

std::string GroupName(const QueryFrames& group) {
  std::string_view first;
  for (const QueryFrame& frame : group) {
    for (const QueryFrame::Image& image : frame.images)
      first = first.empty() ? image.name : std::min(first, image.name);
  }
  return std::string(first);
}

// Warns once of the depth maps that were not used.
void WarnOfDepthMaps(const QueryRecords& records) {
  std::set<std::string> contradicted, without_scale;
  records.ForEach([&](const QueryRecord& record) {
    if (!record.result.depth) return;
    for (const DepthMapResult& map : record.result.depth->maps) {
      if (map.verdict == DepthVerdict::CONTRADICTED) contradicted.insert(map.database_name);
      if (map.verdict == DepthVerdict::NO_SCALE) without_scale.insert(map.database_name);
    }
  });
  const auto warn = [](const std::set<std::string>& names, const std::string& reason) {
    if (names.empty()) return;
    PrintWarning("depth maps left out for " + std::to_string(names.size()) + " database images (for example " +
                 *names.begin() + "): " + reason);
  };
  warn(contradicted, "triangulated points contradict them");
  warn(without_scale, "too few triangulated points tell their scale, and --LazyLocalizer.depth_is_metric is 0");
}

}  // namespace

std::string DescribeCamera(const SharedCamera& shared) {
  const Camera& camera = shared.camera;
  std::string params;
  for (const double param : camera.params) params += Format(params.empty() ? "%.10g" : ",%.10g", param);
  const double stddev_px = MeanFocalLength(camera) * std::sqrt(shared.covariance(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR));
  const std::string id = shared.database_id == 0 ? "" : Format(" %u", shared.database_id);
  return Format("camera%s of %d queries, focal length +- %.2g px: ", id.c_str(), shared.num_queries, stddev_px) +
         "--ImageReader.camera_model " + CameraModelName(camera.model_id) + " --ImageReader.camera_params " + params;
}

std::vector<size_t> GroupsOfShard(const QuerySource& source, const std::optional<Shard>& shard) {
  std::vector<size_t> groups;
  for (size_t i = 0; i < source.NumGroups(); ++i) {
    if (!shard || shard->Has(GroupName(source.Selection().Groups().At(i)))) groups.push_back(i);
  }
  return groups;
}

RunManifest MakeManifest(const CommandOptions& options, const QuerySource& source, const Fingerprint& model,
                         const std::vector<size_t>& groups) {
  RunManifest manifest;
  manifest.program = ProgramVersion();
  manifest.options = OptionsWith(options, {OptionRole::METHOD});
  manifest.other_options = OptionsWith(options, {OptionRole::MACHINE, OptionRole::OUTPUT});
  for (const auto& [name, path] : OptionsWith(options, {OptionRole::INPUT})) {
    if (path.empty()) continue;
    const bool is_large = name == "depth_path" || name == "onnx_path";
    manifest.inputs[name] = {path, name == "input_path" ? model
                                   : is_large           ? FingerprintOfTree(path)
                                                        : FingerprintOf(path)};
  }
  manifest.num_groups = source.NumGroups();
  manifest.num_queries = source.NumQueries();
  manifest.extraction = source.DescribeExtraction();
  manifest.shard = ParseShard(options.shard);
  for (const size_t group : groups) {
    for (const QueryFrame& frame : source.Selection().Groups().At(group)) {
      manifest.num_own_queries += frame.images.size();
    }
  }
  return manifest;
}

std::optional<LeaveOneOutSummary> WriteResults(const CommandOptions& options, const RunManifest& manifest,
                                               const Model& model, const DatabaseContent& database,
                                               const QueryRecords& records, const SharedCameras& shared_cameras,
                                               const std::filesystem::path& staging_parent, ResultWriter* writer) {
  records.ForEach([](const QueryRecord& record) {
    const LocalizationResult& result = record.result;
    if (result.status != QueryStatus::LOCALIZED || result.intrinsics.contradiction.empty()) return;
    PrintWarning("query " + result.query_name + ": " + result.intrinsics.contradiction);
  });
  WarnOfDepthMaps(records);
  std::string comments = "# written by " + ProgramVersion() + "\n";
  if (!manifest.extraction.empty()) comments += "# " + manifest.extraction + "\n";
  for (const SharedCamera& shared : shared_cameras) comments += "# " + DescribeCamera(shared) + "\n";
  std::optional<LeaveOneOutSummary> leave_one_out;
  if (options.source.selection.leave_one_out) leave_one_out = SummarizeLeaveOneOut(model, records);
  writer->Write(model, records, database, comments + OptionsAsIni(options), leave_one_out ? &*leave_one_out : nullptr,
                staging_parent);
  return leave_one_out;
}

}  // namespace lazyloc
