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

}  // namespace lazyloc
