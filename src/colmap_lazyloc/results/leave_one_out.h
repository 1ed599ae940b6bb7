#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "colmap_lazyloc/runs/query_records.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Number of standard deviations, and ratio of the scene's size. A position that is off by more than both counts as
// wrong: not where its covariance says, and not by so little that it hardly matters.
inline constexpr double kMaxRightErrorSigma = 5;
inline constexpr double kMaxRightErrorRatio = 0.005;

// A query that has a pose, compared with its pose in the model.
struct CheckedPose {
  std::string name;
  bool is_accepted = false;  // LOCALIZED
  double confidence = 0;
  double position_error = 0, rotation_error_deg = 0;
  double position_error_sigma = 0;  // by the position's covariance
  bool is_wrong = false;
};

// Coverage: share of all queries whose confidence is at least `confidence`. Risk: share of wrong ones among these.
struct RiskPoint {
  double confidence = 0, coverage = 0, risk = 0;
};

// How well the poses of queries that were localized without their own image agree with the model.
struct LeaveOneOutSummary {
  size_t num_queries = 0;
  std::map<std::string, size_t> num_by_status;
  // Diagonal of the box around the model's cameras, but at least the median distance to the points.
  double scene_size = 0;
  std::vector<CheckedPose> poses;        // by descending confidence
  std::vector<RiskPoint> risk_coverage;  // one for each distinct confidence, descending
  // Probability that a right pose has a higher confidence than a wrong one; nullopt if there are none of either.
  std::optional<double> auroc;
};

// records: of a run with leave_one_out. Poses without a confidence or a covariance are left out.
LeaveOneOutSummary SummarizeLeaveOneOut(const Model& model, const QueryRecords& records);

// Writes the summary as JSON. Throws InputError naming the file if it cannot be written.
void WriteLeaveOneOut(const std::filesystem::path& path, const LeaveOneOutSummary& summary);

// Returns the summary as lines for a terminal.
std::string FormatLeaveOneOut(const LeaveOneOutSummary& summary);

}  // namespace lazyloc
