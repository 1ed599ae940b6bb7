#include "colmap_lazyloc/group/pair_fit.h"

#include <algorithm>

#include "colmap_lazyloc/group/options.h"
#include "colmap_lazyloc/scene/epipolar_error.h"

namespace lazyloc {

bool FitsPoses(const PosedImages& posed, const PairGeometry& pair) {
  constexpr double kMaxErrorPx = 2 * kStartNoisePx;
  const Rigid3d query_from_other = CamFromWorld(posed, pair.query) * Inverse(CamFromWorld(posed, pair.other));
  const auto num_near = std::count_if(pair.inliers.begin(), pair.inliers.end(), [&](const ObservedMatch& match) {
    return MeasureEpipolarError(query_from_other, match.query, match.other).squared_px <= kMaxErrorPx * kMaxErrorPx;
  });
  return 2 * num_near > static_cast<std::ptrdiff_t>(pair.inliers.size());
}

}  // namespace lazyloc
