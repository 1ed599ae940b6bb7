#include "colmap_lazyloc/results/result_text.h"

#include <cmath>
#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/results/map_pose.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kPosesHeader[] =
    "# Poses of the localized queries, one line each:\n"
    "#   name qw qx qy qz tx ty tz\n"
    "# cam_from_world: x_cam = R x_world + t, with R from the quaternion, scalar first. The camera frame is COLMAP's:\n"
    "# x right, y down, z forward. Lengths are in the unit of the database.\n"
    "# A name may hold blanks: the pose is the last seven words.\n"
    "# Covariances are in results.jsonl: 6x6, rotation w (rad, R <- exp(w) R) first, then t.\n";

constexpr char kRigPosesHeader[] =
    "# Poses of rig frames with a localized query, one line each:\n"
    "#   name qw qx qy qz tx ty tz\n"
    "# rig_from_world, otherwise as in poses.txt.\n";

// Returns the quaternion scalar first, with the sign that makes w >= 0.
Eigen::Vector4d Qvec(const Eigen::Quaterniond& rotation) {
  const Eigen::Vector4d qvec(rotation.w(), rotation.x(), rotation.y(), rotation.z());
  return std::signbit(qvec[0]) ? Eigen::Vector4d(-qvec) : qvec;
}

void WritePoseLine(const std::string& name, const Rigid3d& pose, OutputFile* file) {
  file->Text() << name;
  for (const double number : Qvec(pose.rotation)) file->Text() << ' ' << number;
  for (const double number : pose.translation) file->Text() << ' ' << number;
  file->Text() << '\n';
}

template <typename Vector>
Json ToJson(const Vector& vector) {
  Json json = Json::array();
  for (const double number : vector) json.push_back(number);
  return json;
}

Json PoseToJson(const Rigid3d& pose) {
  return {{"qvec", ToJson(Qvec(pose.rotation))}, {"tvec", ToJson(pose.translation)}};
}

template <int size>
Json CovarianceToJson(const Eigen::Matrix<double, size, size>& covariance) {
  Json rows = Json::array();
  for (int row = 0; row < size; ++row) rows.push_back(ToJson(Eigen::Matrix<double, size, 1>(covariance.row(row))));
  return rows;
}

Json CameraToJson(const Camera& camera) {
  return {{"model", CameraModelName(camera.model_id)},
          {"width", camera.width},
          {"height", camera.height},
          {"params", ToJson(camera.params)}};
}

Json BearingToJson(const Bearing& bearing) {
  return {{"from", bearing.database_name},
          {"direction", ToJson(bearing.dir_database_to_query_in_world)},
          {"stddev_deg", RadToDeg(bearing.stddev_rad)}};
}

Json RunnerUpToJson(const RunnerUp& runner_up) {
  return {{"explanation", runner_up.explanation},
          {"odds", runner_up.odds},
          {"cam_from_world", PoseToJson(runner_up.cam_from_world)},
          {"position", ToJson(CamInWorld(runner_up.cam_from_world))}};
}

// Adds the confidence in the pose, the evidence for it and what competes with it.
void AddConfidence(const LocalizationResult& result, Json* json) {
  (*json)["confidence"] = result.confidence ? Json(*result.confidence) : Json();
  Json& evidence = (*json)["evidence"] = nullptr;
  if (!result.confidence) return;
  ForEachEvidence(result.evidence, [&](const char* name, const double* value) { evidence[name] = *value; });
  if (result.runner_up) (*json)["runner_up"] = RunnerUpToJson(*result.runner_up);
}

// Adds the pose in the map and its angles, which a query has that was localized.
void AddMapPose(const LocalizationResult& result, const WorldAxes& axes, Json* json) {
  const bool is_localized = result.status == QueryStatus::LOCALIZED;
  const MapPose pose = is_localized ? MakeMapPose(result, axes) : MapPose();
  (*json)["world_from_cam"] = is_localized ? PoseToJson(pose.world_from_cam) : Json();
  (*json)["position_covariance"] =
      pose.covariance ? CovarianceToJson<3>(pose.covariance->topLeftCorner<3, 3>()) : Json();
  (*json)["pose_covariance_in_map"] = pose.covariance ? CovarianceToJson<6>(*pose.covariance) : Json();
  ForEachAngle(pose.angles, [&](const std::string& name, const CameraAngle& angle) {
    (*json)[name + "_deg"] = angle.deg ? Json(*angle.deg) : Json();
    (*json)[name + "_stddev_deg"] = angle.stddev_deg ? Json(*angle.stddev_deg) : Json();
  });
}

// Adds the pose, or the part of it that is known, and its standard deviations.
void AddPose(const LocalizationResult& result, Json* json) {
  for (const char* field : {"cam_from_world", "unconfirmed_cam_from_world", "covariance", "position",
                            "position_stddevs", "weakest_direction", "rotation_stddev_deg", "rotation", "bearing"}) {
    (*json)[field] = nullptr;
  }
  if (HasPose(result.status)) {
    const bool is_localized = result.status == QueryStatus::LOCALIZED;
    (*json)[is_localized ? "cam_from_world" : "unconfirmed_cam_from_world"] = PoseToJson(result.cam_from_world);
    if (is_localized) (*json)["position"] = ToJson(CamInWorld(result.cam_from_world));
    if (!result.covariance.allFinite()) return;
    (*json)["covariance"] = CovarianceToJson<6>(result.covariance);
    (*json)["position_stddevs"] = ToJson(result.spread.position_stddevs);
    (*json)["weakest_direction"] = ToJson(result.spread.weakest_direction_in_world);
    (*json)["rotation_stddev_deg"] = RadToDeg(result.spread.rotation_stddev_rad);
  } else if (result.partial_pose) {
    const PartialPose& partial = *result.partial_pose;
    (*json)["rotation"] = ToJson(Qvec(partial.cam_from_world_rotation));
    if (partial.rotation_stddev_rad) (*json)["rotation_stddev_deg"] = RadToDeg(*partial.rotation_stddev_rad);
    if (partial.bearing) (*json)["bearing"] = BearingToJson(*partial.bearing);
  }
}

Json IntrinsicsToJson(const IntrinsicsResult& intrinsics) {
  const bool is_tested = intrinsics.verdict != IntrinsicsVerdict::NOT_TESTED;
  Json json = {{"origin", EnumName(intrinsics.origin)},
               {"verdict", EnumName(intrinsics.verdict)},
               {"focal_factor", is_tested ? Json(intrinsics.focal_factor) : Json()},
               {"focal_factor_stddev", is_tested ? Json(intrinsics.focal_factor_stddev) : Json()},
               {"contradiction", intrinsics.contradiction.empty() ? Json() : Json(intrinsics.contradiction)}};
  if (intrinsics.origin == IntrinsicsOrigin::JOINT) json["covariance"] = CovarianceToJson<6>(intrinsics.covariance);
  return json;
}

Json PriorToJson(const std::optional<PriorResult>& prior, double deviation_unit) {
  if (!prior) return nullptr;
  const bool is_tested = prior->verdict != PriorVerdict::NOT_TESTED;
  return {{"verdict", EnumName(prior->verdict)},
          {"fixes", EnumName(prior->fixes)},
          {"deviation", is_tested ? Json(prior->deviation / deviation_unit) : Json()},
          {"deviation_sigma", is_tested ? Json(prior->deviation_sigma) : Json()}};
}

Json PairsToJson(const std::vector<PairResult>& pairs) {
  Json json = Json::array();
  for (const PairResult& pair : pairs) {
    json.push_back({{"name", pair.database_name},
                    {"num_inliers", pair.num_inliers},
                    {"rotation_error_deg", pair.rotation_error_deg},
                    {"direction_error_deg", pair.direction_error_deg}});
  }
  return json;
}

Json PoseNoiseToJson(const DatabasePoseNoise& noise) {
  Json json = {{"source", EnumName(noise.source)}, {"num_pairs", noise.num_pairs}};
  const bool is_in_px = noise.viewpoint_px > 0;
  json["viewpoint_px"] = is_in_px ? Json(noise.viewpoint_px) : Json();
  json["rotation_px"] = is_in_px ? Json(noise.rotation_px) : Json();
  json["position_px"] = is_in_px ? Json(noise.position_px) : Json();
  return json;
}

Json DepthToJson(const DepthResult& depth) {
  Json maps = Json::array();
  for (const DepthMapResult& map : depth.maps) {
    const bool is_used = map.verdict == DepthVerdict::USED;
    maps.push_back({{"name", map.database_name},
                    {"verdict", EnumName(map.verdict)},
                    {"num_points", map.num_points},
                    {"depth_stddev_ratio", map.depth_stddev > 0 ? Json(map.depth_stddev) : Json()},
                    {"scale", is_used ? Json(map.scale) : Json()},
                    {"scale_stddev_ratio", is_used ? Json(map.scale_stddev) : Json()}});
  }
  return {{"fixes", depth.fixes_distance ? "distance" : "nothing"}, {"num_points", depth.num_points}, {"maps", maps}};
}

Json SecondsToJson(const QueryRecord& record) {
  Json json = Json::object();
  for (const auto& [stage, seconds] : record.seconds) json[stage] = seconds;
  json["total"] = record.total_seconds;
  return json;
}

Json RecordToJson(const QueryRecord& record, const WorldAxes& axes) {
  const LocalizationResult& result = record.result;
  Json json;
  json["name"] = result.query_name;
  json["status"] = QueryStatusName(result.status);
  json["reason"] = result.reason;
  json["start"] = result.start;
  AddConfidence(result, &json);
  AddPose(result, &json);
  AddMapPose(result, axes, &json);
  if (record.epoch) {
    json["epoch"] = {{"hangs_on", record.epoch->hangs_on_others ? "new_photos" : "database"},
                     {"is_adjusted", record.epoch->is_adjusted},
                     {"shift", record.epoch->shift}};
  }
  const bool has_rig = !result.frame_name.empty();
  json["frame"] = has_rig ? Json(result.frame_name) : Json();
  json["rig_from_world"] =
      has_rig && result.status == QueryStatus::LOCALIZED ? PoseToJson(result.rig_from_world) : Json();
  if (has_rig && result.rig_scale != 1) json["rig_scale"] = result.rig_scale;
  json["rig_error_px"] = result.rig_error_px ? Json(*result.rig_error_px) : Json();
  if (result.status == QueryStatus::LOCALIZED && result.is_camera_refined) {
    json["camera"] = CameraToJson(result.query_camera);
  }
  if (result.database_pose_noise) json["database_pose_noise"] = PoseNoiseToJson(*result.database_pose_noise);
  if (result.depth) json["depth"] = DepthToJson(*result.depth);
  json["intrinsics"] = IntrinsicsToJson(result.intrinsics);
  json["intrinsics_source"] = record.intrinsics_source ? Json(EnumName(*record.intrinsics_source)) : Json();
  if (record.matcher) json["matching_type"] = EnumName(*record.matcher);
  if (const QueryPriorResult& priors = result.priors; priors.position || priors.gravity) {
    json["priors"] = {{"position", PriorToJson(priors.position, 1)},
                      {"gravity", PriorToJson(priors.gravity, DegToRad(1))}};
  }
  json["num_tracks"] = result.num_tracks;
  json["num_observations"] = result.num_observations;
  json["mean_reprojection_error_px"] = result.num_observations > 0 ? Json(result.mean_reprojection_error_px) : Json();
  json["pairs"] = PairsToJson(result.pairs);
  if (!record.damages.empty()) json["damaged_records"] = record.damages;
  json["seconds"] = SecondsToJson(record);
  return json;
}

// Escapes the bytes of names that are not UTF-8, because readers of JSON refuse them.
void EscapeNames(Json* json) {
  if (json->is_string()) {
    *json = ValidUtf8(json->get_ref<const std::string&>());
  } else if (json->is_structured()) {
    for (Json& element : *json) EscapeNames(&element);
  }
}

}  // namespace

void WritePoses(const std::filesystem::path& path, const QueryRecords& records) {
  OutputFile file(path);
  file.Text() << kPosesHeader;
  records.ForEach([&](const QueryRecord& record) {
    const LocalizationResult& result = record.result;
    if (result.status == QueryStatus::LOCALIZED) WritePoseLine(result.query_name, result.cam_from_world, &file);
  });
  file.Close();
}

void WriteRigPoses(const std::filesystem::path& path, const QueryRecords& records) {
  std::map<std::string, Rigid3d> rigs_from_world;
  records.ForEach([&](const QueryRecord& record) {
    const LocalizationResult& result = record.result;
    if (result.status != QueryStatus::LOCALIZED || result.frame_name.empty()) return;
    rigs_from_world.emplace(result.frame_name, result.rig_from_world);
  });
  if (rigs_from_world.empty()) return;
  OutputFile file(path);
  file.Text() << kRigPosesHeader;
  for (const auto& [name, pose] : rigs_from_world) WritePoseLine(name, pose, &file);
  file.Close();
}

std::string ResultLine(const QueryRecord& record, const WorldAxes& axes) {
  Json json = RecordToJson(record, axes);
  EscapeNames(&json);
  return json.dump();  // JSON writes numbers that are not finite as null
}

void WriteResultsJson(const std::filesystem::path& path, const QueryRecords& records, const WorldAxes& axes) {
  OutputFile file(path);
  records.ForEach([&](const QueryRecord& record) { file.Text() << ResultLine(record, axes) << '\n'; });
  file.Close();
}

}  // namespace lazyloc
