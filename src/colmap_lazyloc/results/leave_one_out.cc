#include "colmap_lazyloc/results/leave_one_out.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/results/model_merger.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/scene/pose_distribution.h"

namespace lazyloc {
namespace {

using Json = nlohmann::ordered_json;

Rigid3d Normalized(const Rigid3d& pose) { return {pose.rotation.normalized(), pose.translation}; }

// Returns the diagonal of the box around the centres of all images and around what they look at: the points of their
// optical axes at the median distance of points from queries. A camera that only turns has a scene, too.
double SceneSize(const Model& model, const QueryRecords& records) {
  std::vector<double> distances;
  records.ForEach([&](const QueryRecord& record) {
    const double distance = record.result.evidence.scene_distance;  // NaN for a pose without points
    if (record.result.confidence && std::isfinite(distance)) distances.push_back(distance);
  });
  const double distance = distances.empty() ? 0 : Median(std::move(distances));
  Eigen::AlignedBox3d box;
  for (const ModelImage& image : model.images) {
    const Rigid3d pose = Normalized(image.cam_from_world);
    box.extend(CamInWorld(pose));
    box.extend(CamInWorld(pose) + distance * (pose.rotation.conjugate() * Eigen::Vector3d::UnitZ()));
  }
  return box.isEmpty() ? 0 : box.diagonal().norm();
}

CheckedPose CheckPose(const LocalizationResult& result, const Rigid3d& true_pose, double scene_size) {
  CheckedPose checked{result.query_name, result.status == QueryStatus::LOCALIZED, *result.confidence};
  const Eigen::Vector3d error = CamInWorld(result.cam_from_world) - CamInWorld(true_pose);
  checked.position_error = error.norm();
  checked.rotation_error_deg = RadToDeg(AngularDistanceRad(result.cam_from_world.rotation, true_pose.rotation));
  const Eigen::Matrix3d covariance =
      MakePoseDistribution(result.cam_from_world, result.covariance).PositionCovariance();
  checked.position_error_sigma = std::sqrt(std::max(0.0, error.dot(covariance.ldlt().solve(error))));
  checked.is_wrong =
      checked.position_error_sigma > kMaxRightErrorSigma && checked.position_error > kMaxRightErrorRatio * scene_size;
  return checked;
}

// poses: by descending confidence.
std::vector<RiskPoint> RiskCoverage(const std::vector<CheckedPose>& poses, size_t num_queries) {
  std::vector<RiskPoint> points;
  double num_wrong = 0;
  for (size_t i = 0; i < poses.size(); ++i) {
    num_wrong += poses[i].is_wrong;
    if (i + 1 < poses.size() && poses[i + 1].confidence == poses[i].confidence) continue;
    const auto num_accepted = static_cast<double>(i + 1);
    points.push_back({poses[i].confidence, num_accepted / static_cast<double>(num_queries), num_wrong / num_accepted});
  }
  return points;
}

// Returns the area under the ROC curve; ties count half. poses: by descending confidence.
std::optional<double> Auroc(const std::vector<CheckedPose>& poses) {
  double num_right = 0, num_wrong = 0, num_ordered_pairs = 0;
  for (auto begin = poses.begin(); begin != poses.end();) {
    const auto end =
        std::find_if(begin, poses.end(), [&](const CheckedPose& pose) { return pose.confidence != begin->confidence; });
    const auto wrong = static_cast<double>(std::count_if(begin, end, std::mem_fn(&CheckedPose::is_wrong)));
    const double right = static_cast<double>(end - begin) - wrong;
    num_ordered_pairs += wrong * (num_right + right / 2);
    num_right += right;
    num_wrong += wrong;
    begin = end;
  }
  const double num_pairs = num_right * num_wrong;
  return num_pairs == 0 ? std::nullopt : std::make_optional(num_ordered_pairs / num_pairs);
}

// Returns the median over the accepted poses; NaN without any, which JSON writes as null.
double MedianOfAccepted(const LeaveOneOutSummary& summary, double CheckedPose::*field) {
  std::vector<double> values;
  for (const CheckedPose& pose : summary.poses) {
    if (pose.is_accepted) values.push_back(pose.*field);
  }
  return values.empty() ? NAN : Median(std::move(values));
}

size_t NumAccepted(const LeaveOneOutSummary& summary, bool only_wrong) {
  return std::count_if(summary.poses.begin(), summary.poses.end(),
                       [&](const CheckedPose& pose) { return pose.is_accepted && (pose.is_wrong || !only_wrong); });
}

}  // namespace

LeaveOneOutSummary SummarizeLeaveOneOut(const Model& model, const QueryRecords& records) {
  LeaveOneOutSummary summary;
  summary.num_queries = records.Size();
  summary.scene_size = SceneSize(model, records);
  records.ForEach([&](const QueryRecord& record) {
    const LocalizationResult& result = record.result;
    ++summary.num_by_status[QueryStatusName(result.status)];
    if (!result.confidence || !result.covariance.allFinite()) return;
    const ModelImage* image = FindByName(model.images, result.query_name);
    if (image == nullptr) return;
    summary.poses.push_back(CheckPose(result, Normalized(image->cam_from_world), summary.scene_size));
  });
  std::stable_sort(summary.poses.begin(), summary.poses.end(),
                   [](const CheckedPose& a, const CheckedPose& b) { return a.confidence > b.confidence; });
  summary.risk_coverage = RiskCoverage(summary.poses, summary.num_queries);
  summary.auroc = Auroc(summary.poses);
  return summary;
}

void WriteLeaveOneOut(const std::filesystem::path& path, const LeaveOneOutSummary& summary) {
  Json json;
  json["num_queries"] = summary.num_queries;
  json["num_by_status"] = summary.num_by_status;
  json["scene_size"] = summary.scene_size;
  json["median_position_error"] = MedianOfAccepted(summary, &CheckedPose::position_error);
  json["median_position_error_sigma"] = MedianOfAccepted(summary, &CheckedPose::position_error_sigma);
  json["median_rotation_error_deg"] = MedianOfAccepted(summary, &CheckedPose::rotation_error_deg);
  json["num_accepted"] = NumAccepted(summary, false);
  json["num_accepted_and_wrong"] = NumAccepted(summary, true);
  json["auroc"] = summary.auroc.value_or(NAN);
  json["risk_coverage"] = Json::array();
  for (const RiskPoint& point : summary.risk_coverage) {
    json["risk_coverage"].push_back(
        {{"confidence", point.confidence}, {"coverage", point.coverage}, {"risk", point.risk}});
  }
  json["poses"] = Json::array();
  for (const CheckedPose& pose : summary.poses) {
    json["poses"].push_back({{"name", ValidUtf8(pose.name)},
                             {"confidence", pose.confidence},
                             {"is_accepted", pose.is_accepted},
                             {"is_wrong", pose.is_wrong},
                             {"position_error", pose.position_error},
                             {"position_error_sigma", pose.position_error_sigma},
                             {"rotation_error_deg", pose.rotation_error_deg}});
  }
  OutputFile file(path);
  file.Text() << json.dump(1) << '\n';
  file.Close();
}

std::string FormatLeaveOneOut(const LeaveOneOutSummary& summary) {
  std::string text = "\nDatabase images localized against the others\n";
  text += Format("  %-34s%10.3f (size of the scene: %.3g)\n", "median position error",
                 MedianOfAccepted(summary, &CheckedPose::position_error), summary.scene_size);
  text +=
      Format("  %-34s%10.3f standard deviations\n", "", MedianOfAccepted(summary, &CheckedPose::position_error_sigma));
  text += Format("  %-34s%10.3f deg\n", "median rotation error",
                 MedianOfAccepted(summary, &CheckedPose::rotation_error_deg));
  text += Format("  %-34s%6zu of %zu (off by more than %.0f standard deviations and %.1f %% of the scene)\n",
                 "localized but wrong", NumAccepted(summary, true), NumAccepted(summary, false), kMaxRightErrorSigma,
                 100 * kMaxRightErrorRatio);
  if (summary.auroc)
    text += Format("  %-34s%10.3f (1: each right pose has more confidence than each wrong one)\n",
                   "AUROC of the confidence", *summary.auroc);
  return text;
}

}  // namespace lazyloc
