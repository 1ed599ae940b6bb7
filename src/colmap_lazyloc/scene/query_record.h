#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/intrinsics_source.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/localization_result.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {

// What an adjustment of new photos together has made of a query.
struct EpochResult {
  bool hangs_on_others = false;  // true if only matches with other new photos give its pose
  bool is_adjusted = false;      // false if it keeps the pose that it was localized at
  double shift = 0;              // of the position, by the adjustment
};

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
  std::optional<EpochResult> epoch = std::nullopt;  // nullopt if it was not adjusted with other queries
};

}  // namespace lazyloc
