#pragma once

#include <array>
#include <string>

#include "colmap_lazyloc/scene/enum_names.h"

namespace lazyloc {

enum class QueryStatus {
  LOCALIZED,
  DAMAGED_DATA,             // a record of the database that the query needs is damaged
  UNREADABLE_IMAGE,         // the photo cannot be read as an image
  UNKNOWN_CAMERA,           // the focal length is unknown, and the images do not determine it
  NO_FEATURES,              // the query has no keypoints
  NO_PAIRS,                 // no database image shares matches with the query
  TOO_FEW_INLIERS,          // no pair has enough verified inliers
  INCONSISTENT_ROTATIONS,   // the pairs contradict each other
  INCONSISTENT_INTRINSICS,  // the given intrinsics contradict the images or the photo
  INCONSISTENT_RIG,         // the images of a rig contradict its calibration
  SCALE_UNOBSERVABLE,       // one usable baseline: orientation and bearing, but no position
  DEGENERATE_BASELINE,      // no baseline, or database cameras and query are collinear
  TOO_FEW_TRACKS,           // too few tracks can be triangulated
  DIVERGED,                 // bundle adjustment ended without a usable pose
  LOW_CONFIDENCE,           // there is a pose, but too little evidence that it is right
};
template <>
inline constexpr std::array<const char*, 15> kEnumNames<QueryStatus> = {"LOCALIZED",
                                                                        "DAMAGED_DATA",
                                                                        "UNREADABLE_IMAGE",
                                                                        "UNKNOWN_CAMERA",
                                                                        "NO_FEATURES",
                                                                        "NO_PAIRS",
                                                                        "TOO_FEW_INLIERS",
                                                                        "INCONSISTENT_ROTATIONS",
                                                                        "INCONSISTENT_INTRINSICS",
                                                                        "INCONSISTENT_RIG",
                                                                        "SCALE_UNOBSERVABLE",
                                                                        "DEGENERATE_BASELINE",
                                                                        "TOO_FEW_TRACKS",
                                                                        "DIVERGED",
                                                                        "LOW_CONFIDENCE"};

// Why a query is not LOCALIZED.
struct Refusal {
  QueryStatus status;
  std::string reason;  // one sentence
};

// Returns true if the query has a pose, even if it is not to be relied on.
inline bool HasPose(QueryStatus status) {
  return status == QueryStatus::LOCALIZED || status == QueryStatus::LOW_CONFIDENCE;
}
inline const char* QueryStatusName(QueryStatus status) { return EnumName(status); }

}  // namespace lazyloc
