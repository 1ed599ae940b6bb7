#pragma once

#include <memory>
#include <string>

#include "colmap_lazyloc/features/aliked.h"
#include "colmap_lazyloc/features/feature_method.h"
#include "colmap_lazyloc/features/feature_statistics.h"

namespace lazyloc {

// Options of all methods.
struct FeatureOptions {
  SiftExtractionOptions sift;
  AlikedOptions aliked;
  MatcherType matcher = MatcherType::AUTO;

  bool Check(std::string* error) const { return sift.Check(error) && aliked.Check(error); }
};

// What photos are matched by.
struct FeatureMethods {
  std::unique_ptr<const FeatureMethod> database;  // features of the database's type
  // For photos that these do not localize; null if there is none.
  std::unique_ptr<const FeatureMethod> fallback;
  bool is_fallback_first = false;  // true if the options name it, so that nothing else is tried
};

// Returns the methods for a database with features of this type. Throws InputError, which begins with the path of the
// database or the name of an option, if photos cannot have such features, or if a model is missing.
FeatureMethods MakeFeatureMethods(FeatureType database_type, const FeatureStatistics& statistics,
                                  const PhotoScale& database_scale, const std::string& database_path,
                                  const FeatureOptions& options);

}  // namespace lazyloc
