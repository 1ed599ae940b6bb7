#pragma once

#include <string>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/math/parallel_for.h"
#include "colmap_lazyloc/math/ray_pose.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// Extracts features of one type from photos and matches them. Thread-safe: each call depends on its arguments only.
// A new method is one file with a class, and one row of the table in feature_methods.cc.
class FeatureMethod {
 public:
  virtual ~FeatureMethod() = default;

  virtual FeatureType Type() const = 0;
  virtual MatcherType Matcher() const = 0;
  // Returns how photos are extracted and matched, for a sentence of the user's that begins with "photos".
  virtual std::string Describe() const = 0;
  // Returns what features depend on besides the image file, so that kept ones are not taken for those of other options.
  virtual std::string Key() const = 0;
  // True if photos must be read with their colours.
  virtual bool NeedsColours() const = 0;
  // Loads models now rather than with the first photo. Throws InputError naming the file of another model.
  virtual void LoadModels() const {}

  // Returns the features, with keypoints in pixels of the file as stored. focal_length_px: of the photo. Uses idle
  // threads, too.
  virtual Features Extract(const PhotoFile& photo, double focal_length_px, IdleThreads* idle_threads) const = 0;
  // Returns the features that a query is localized with first: these, or those of the largest scales if they are many.
  virtual Features ExtractFirst(const PhotoFile& photo, double focal_length_px, IdleThreads* idle_threads) const {
    return Extract(photo, focal_length_px, idle_threads);
  }
  // Returns the sorted matches. Uses the calling thread alone.
  virtual Matches Match(const Features& query, const Camera& query_camera, const Features& database,
                        const Camera& database_camera) const = 0;
  // True if MatchGuided can be called.
  virtual bool HasGuidedMatching() const { return false; }
  // Returns the sorted matches of features that lie near epipolar lines of each other. rays: one per keypoint, of unit
  // length, or zero where the camera has none. E: query_ray^T E database_ray = 0. max_error_rad: of matched rays.
  virtual Matches MatchGuided(const Features& /*query*/, const Rays& /*query_rays*/, const Features& /*database*/,
                              const Rays& /*database_rays*/, const Eigen::Matrix3d& /*E*/,
                              double /*max_error_rad*/) const {
    return {};
  }
};

}  // namespace lazyloc
