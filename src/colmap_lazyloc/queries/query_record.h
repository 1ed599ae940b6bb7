#pragma once

#include <chrono>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/queries/intrinsics_source.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/matcher_type.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {

// Everything that the output files say of a query.
struct QueryRecord {
  LocalizationResult result;
  std::vector<Eigen::Vector2d> keypoints;  // of a photo, xy in pixels; empty if the database holds them
  StageTimer::Seconds seconds;             // wall time by stage, loading first
  double total_seconds = 0;                // wall time of the whole group, divided by the number of its queries
  std::optional<IntrinsicsSource> intrinsics_source = std::nullopt;  // nullopt if none were looked for
  std::optional<MatcherType> matcher = std::nullopt;  // of a photo whose features were extracted; never AUTO
  // Damaged records of the database that were left out, with what is wrong, as in DamagedRecordError.
  std::vector<std::string> damages = {};
};

// A group that is ready to be localized, and the records of its queries as far as loading knows them.
struct LoadedGroup {
  QueryGroup group;
  std::vector<QueryRecord> records;   // one per image of the group, in the same order
  std::vector<QueryRecord> failures;  // of photos that cannot be used and are not in the group
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
};

// Joins what loading and the pipeline know of the queries of a group, failures first. results: one per image of the
// group. The reason of a query that is not localized says what was left out; without any pair left, the status is
// DAMAGED_DATA. Ends the measurement of the total time.
std::vector<QueryRecord> FinishRecords(LoadedGroup loaded, std::vector<LocalizationResult> results);

}  // namespace lazyloc
