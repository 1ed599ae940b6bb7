#pragma once

#include "colmap_lazyloc/features/feature_method.h"
#include "colmap_lazyloc/features/feature_statistics.h"

namespace lazyloc {

// COLMAP's SIFT features, as many and as coarse as those of the database, by brute force.
class Sift : public FeatureMethod {
 public:
  // database: of its features; database_scale: medians over its images, for Describe.
  Sift(const SiftExtractionOptions& options, const FeatureStatistics& database, const PhotoScale& database_scale)
      : options_(options), database_(database), database_scale_(database_scale) {}

  FeatureType Type() const override { return FeatureType::SIFT; }
  MatcherType Matcher() const override { return MatcherType::SIFT_BRUTEFORCE; }
  std::string Describe() const override;
  std::string Key() const override { return Describe() + (options_.turns_photos ? " upright" : ""); }
  bool NeedsColours() const override { return false; }
  Features Extract(const PhotoFile& photo, double focal_length_px, IdleThreads* idle_threads) const override;
  Features ExtractFirst(const PhotoFile& photo, double focal_length_px, IdleThreads* idle_threads) const override;
  Matches Match(const Features& query, const Camera& query_camera, const Features& database,
                const Camera& database_camera) const override;
  bool HasGuidedMatching() const override { return true; }
  Matches MatchGuided(const Features& query, const Rays& query_rays, const Features& database,
                      const Rays& database_rays, const Eigen::Matrix3d& E, double max_error_rad) const override;

 private:
  const SiftExtractionOptions options_;
  const FeatureStatistics database_;
  const PhotoScale database_scale_;
};

}  // namespace lazyloc
