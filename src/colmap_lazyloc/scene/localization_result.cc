#include "colmap_lazyloc/scene/localization_result.h"

namespace lazyloc {

const char* QueryStatusName(QueryStatus status) {
  switch (status) {
    case QueryStatus::LOCALIZED: return "LOCALIZED";
    case QueryStatus::UNREADABLE_IMAGE: return "UNREADABLE_IMAGE";
    case QueryStatus::UNKNOWN_CAMERA: return "UNKNOWN_CAMERA";
    case QueryStatus::NO_FEATURES: return "NO_FEATURES";
    case QueryStatus::NO_PAIRS: return "NO_PAIRS";
    case QueryStatus::TOO_FEW_INLIERS: return "TOO_FEW_INLIERS";
    case QueryStatus::INCONSISTENT_ROTATIONS: return "INCONSISTENT_ROTATIONS";
    case QueryStatus::INCONSISTENT_RIG: return "INCONSISTENT_RIG";
    case QueryStatus::SCALE_UNOBSERVABLE: return "SCALE_UNOBSERVABLE";
    case QueryStatus::DEGENERATE_BASELINE: return "DEGENERATE_BASELINE";
    case QueryStatus::TOO_FEW_TRACKS: return "TOO_FEW_TRACKS";
    case QueryStatus::DIVERGED: return "DIVERGED";
  }
  return "UNKNOWN";
}

}  // namespace lazyloc
