#include "colmap_lazyloc/features/sift_method.h"

#include "colmap_lazyloc/features/descriptor_matching.h"
#include "colmap_lazyloc/features/guided_matching.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

// Number of features that a query is localized with first, instead of COLMAP's default. With more, it takes longer, but
// poses are not more accurate.
constexpr int kNumFirst = 4000;

}  // namespace

std::string Sift::Describe() const {
  const SiftExtractionOptions chosen = ChooseExtraction(options_, database_, database_scale_);
  return Format(" of %.0f pixels with a focal length of %.0f: at most %d features, first octave %d",
                database_scale_.size_px, database_scale_.focal_length_px, chosen.max_num_features, chosen.first_octave);
}

Features Sift::Extract(const PhotoFile& photo, double focal_length_px, IdleThreads* idle_threads) const {
  return ExtractLikeDatabase(photo, focal_length_px, options_, database_, idle_threads);
}

Features Sift::ExtractFirst(const PhotoFile& photo, double focal_length_px, IdleThreads* idle_threads) const {
  SiftExtractionOptions options = options_;
  // A number that the user has chosen is taken as it is.
  if (options.max_num_features == kDefaultMaxNumFeatures) options.max_num_features = kNumFirst;
  return ExtractLikeDatabase(photo, focal_length_px, options, database_, idle_threads);
}

Matches Sift::Match(const Features& query, const Camera&, const Features& database, const Camera&) const {
  return MatchDescriptors(query.descriptors, database.descriptors);
}

Matches Sift::MatchGuided(const Features& query, const Rays& query_rays, const Features& database,
                          const Rays& database_rays, const Eigen::Matrix3d& E, double max_error_rad) const {
  return MatchAlongEpipolarLines({query.descriptors, query_rays}, {database.descriptors, database_rays}, E,
                                 max_error_rad);
}

}  // namespace lazyloc
