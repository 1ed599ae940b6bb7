#pragma once

#include <vector>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/scene/localization_problem.h"
#include "colmap_lazyloc/scene/shared_camera.h"

namespace lazyloc {

// A single query that was localized with estimated intrinsics.
struct CalibrationQuery {
  QueryGroup group;
  Camera estimate;
  double log_focal_factor = 0, log_focal_stddev = 0;
};

// Estimates the cameras that queries share: those whose given cameras are the same. COLMAP's default models become
// OPENCV, because pixels are not always square. Each query is localized with the
// common intrinsics, which then take a Gauss-Newton step by the scores of all (refinement/intrinsics_score.h), until
// they no longer change; so each query is adjusted by itself, as when it is localized. Leaves out queries whose own
// estimates of the focal length differ from the median, and cameras of a single query.
SharedCameras EstimateSharedCameras(const std::vector<CalibrationQuery>& queries, const LocalizerOptions& options,
                                    IdleThreads* idle_threads);

}  // namespace lazyloc
