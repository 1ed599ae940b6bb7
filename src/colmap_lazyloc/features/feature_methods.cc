#include "colmap_lazyloc/features/feature_methods.h"

#include <array>

#include "colmap_lazyloc/features/sift_method.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Size of images whose features meet none of COLMAP's, because its 1600 pixels take longer and give fewer matches.
constexpr int kMaxFallbackImageSize = 1024;

// What a method is made for.
struct Purpose {
  MatcherType matcher;
  FeatureType database_type;
  bool is_fallback;  // true for photos that the features of the database do not localize
  const FeatureStatistics& statistics;
  const PhotoScale& database_scale;
  const FeatureOptions& options;
};

std::unique_ptr<const FeatureMethod> MakeSift(const Purpose& purpose) {
  return std::make_unique<Sift>(purpose.options.sift, purpose.statistics, purpose.database_scale);
}

std::unique_ptr<const FeatureMethod> MakeAliked(const Purpose& purpose) {
  AlikedOptions options = purpose.options.aliked;
  options.has_full_contrast = purpose.is_fallback;
  if (IsAliked(purpose.database_type)) {
    return std::make_unique<Aliked>(purpose.database_type, purpose.matcher, options);
  }
  options.max_image_size = kMaxFallbackImageSize;
  return std::make_unique<Aliked>(FeatureType::ALIKED_N16ROT, purpose.matcher, options);
}

bool IsSift(FeatureType type) { return type == FeatureType::SIFT; }

bool HasAliked(MatcherType matcher, const FeatureOptions& options) { return HasMatcher(matcher, options.aliked); }

struct MethodRow {
  MatcherType matcher;
  bool (*matches)(FeatureType type);  // true for databases whose features it matches; the first row is their default
  std::unique_ptr<const FeatureMethod> (*make)(const Purpose& purpose);
  // True if all files are there. Null for a method that no photo falls back to. The last row is the best fallback.
  bool (*can_be_fallback)(MatcherType matcher, const FeatureOptions& options);
};

constexpr std::array kMethods = {
    MethodRow{MatcherType::SIFT_BRUTEFORCE, IsSift, MakeSift, nullptr},
    MethodRow{MatcherType::ALIKED_BRUTEFORCE, IsAliked, MakeAliked, HasAliked},
    MethodRow{MatcherType::ALIKED_LIGHTGLUE, IsAliked, MakeAliked, HasAliked},
};

// Returns the row of a matcher; of the default for such a database if it is AUTO. Null if there is none.
const MethodRow* FindRow(MatcherType matcher, FeatureType database_type) {
  for (const MethodRow& row : kMethods) {
    if (matcher == MatcherType::AUTO ? row.matches(database_type) : row.matcher == matcher) return &row;
  }
  return nullptr;
}

// Returns the best fallback, other than the default of the database. If no model is there, returns the one whose models
// an error is to name, unless the database does without; null if photos have no fallback.
const MethodRow* FindFallback(const MethodRow& of_database, const FeatureOptions& options) {
  if (options.aliked.onnx_path.empty()) return nullptr;
  for (size_t i = kMethods.size(); i-- > 0;) {
    const MethodRow& row = kMethods[i];
    const bool is_other = row.can_be_fallback != nullptr && row.matcher != of_database.matcher;
    if (is_other && row.can_be_fallback(row.matcher, options)) return &row;
  }
  return of_database.can_be_fallback == nullptr ? &kMethods.back() : nullptr;
}

}  // namespace

FeatureMethods MakeFeatureMethods(FeatureType database_type, const FeatureStatistics& statistics,
                                  const PhotoScale& database_scale, const std::string& database_path,
                                  const FeatureOptions& options) {
  const std::string problem = database_path + ": has features of type " + EnumName(database_type);
  const MethodRow* of_database = FindRow(MatcherType::AUTO, database_type);
  if (of_database == nullptr) {
    throw InputError(problem + ", which cannot be extracted from photos: only SIFT and ALIKED can");
  }
  const MethodRow* named = options.matcher == MatcherType::AUTO ? nullptr : FindRow(options.matcher, database_type);
  const MethodRow* fallback = nullptr;
  if (named == nullptr) {
    fallback = FindFallback(*of_database, options);
  } else if (named->matches(database_type)) {
    of_database = named;
  } else if (named->can_be_fallback != nullptr) {
    fallback = named;
  } else {
    throw InputError(problem + ", which --FeatureMatching.type " + EnumName(options.matcher) + " does not match");
  }
  const auto make = [&](const MethodRow& row, bool is_fallback) {
    return row.make({row.matcher, database_type, is_fallback, statistics, database_scale, options});
  };
  FeatureMethods methods;
  methods.database = make(*of_database, false);
  methods.database->LoadModels();
  if (fallback == nullptr) return methods;
  methods.fallback = make(*fallback, true);
  methods.is_fallback_first = fallback == named;
  if (methods.is_fallback_first) methods.fallback->LoadModels();
  return methods;
}

}  // namespace lazyloc
