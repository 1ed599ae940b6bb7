#include "colmap_lazyloc/group/localizer_options.h"

#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {

bool LocalizerOptions::Check(std::string* error) const {
  OPTION_GE(database_pose_stddev_deg, -1);
  OPTION_GE(database_pose_stddev_length, -1);
  OPTION_GE(rig_noise_px, 0);
  OPTION_GE(focal_length_stddev_ratio, 0);
  OPTION_GE(min_confidence, 0);
  OPTION_LE(min_confidence, 1);
  OPTION_GT(max_position_stddev_ratio, 0);
  if (intrinsics == IntrinsicsMode::REFINE && method == Method::PAPER) {
    *error = "intrinsics = refine needs method = extended";
    return false;
  }
  return triangulation.Check(error) && bundle_adjustment.Check(error);
}

}  // namespace lazyloc
