#include "colmap_lazyloc/bridge/sift_replacement.h"

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <colmap/estimators/two_view_geometry.h>
#include <colmap/feature/extractor.h>
#include <colmap/feature/matcher.h>
#include <colmap/math/random.h>

#include "colmap_lazyloc/bridge/sift.h"

namespace lazyloc {
namespace {

Matches (*match_descriptors)(const Descriptors&, const Descriptors&) = nullptr;  // null: nothing is replaced

class PlainSiftExtractor : public colmap::FeatureExtractor {
 public:
  explicit PlainSiftExtractor(const SiftExtractionOptions& options) : options_(options) {}

  bool Extract(const colmap::Bitmap& bitmap, colmap::FeatureKeypoints* keypoints,
               colmap::FeatureDescriptors* descriptors) override {
    IdleThreads none(0);  // because COLMAP extracts several images at once
    ExtractPlainSift(GreyValues(bitmap), bitmap.Width(), bitmap.Height(), options_, &none, keypoints, descriptors);
    return true;
  }

 private:
  const SiftExtractionOptions options_;
};

class PlainSiftMatcher : public colmap::FeatureMatcher {
 public:
  using Keypoints = std::shared_ptr<const colmap::FeatureKeypoints>;
  using SharedDescriptors = std::shared_ptr<const colmap::FeatureDescriptors>;

  explicit PlainSiftMatcher(std::unique_ptr<colmap::FeatureMatcher> colmaps) : colmaps_(std::move(colmaps)) {}

  // Null stands for the descriptors of the last call.
  void Match(const SharedDescriptors& descriptors1, const SharedDescriptors& descriptors2,
             colmap::FeatureMatches* matches) override {
    if (descriptors1) descriptors1_ = descriptors1;
    if (descriptors2) descriptors2_ = descriptors2;
    matches->clear();
    for (const lazyloc::Match& match : match_descriptors(*descriptors1_, *descriptors2_)) {
      matches->emplace_back(match.query_point, match.other_point);
    }
  }

  void MatchGuided(double max_error, const Keypoints& keypoints1, const Keypoints& keypoints2,
                   const SharedDescriptors& descriptors1, const SharedDescriptors& descriptors2,
                   colmap::TwoViewGeometry* geometry) override {
    colmaps_->MatchGuided(max_error, keypoints1, keypoints2, descriptors1, descriptors2, geometry);
  }

 private:
  const std::unique_ptr<colmap::FeatureMatcher> colmaps_;
  SharedDescriptors descriptors1_, descriptors2_;
};

}  // namespace

#ifdef LAZYLOC_CREATE_SIFT_EXTRACTOR
using Extractor = std::unique_ptr<colmap::FeatureExtractor>;
using Matcher = std::unique_ptr<colmap::FeatureMatcher>;
using ExtractionOptions = colmap::SiftExtractionOptions;
using MatchingOptions = colmap::SiftMatchingOptions;

// COLMAP's functions, and those that the linker puts into their places.
Extractor CreateExtractorByColmap(const ExtractionOptions& options) __asm__("__real_" LAZYLOC_CREATE_SIFT_EXTRACTOR);
Extractor CreateExtractor(const ExtractionOptions& options) __asm__("__wrap_" LAZYLOC_CREATE_SIFT_EXTRACTOR);
Matcher CreateMatcherByColmap(const MatchingOptions& options) __asm__("__real_" LAZYLOC_CREATE_SIFT_MATCHER);
Matcher CreateMatcher(const MatchingOptions& options) __asm__("__wrap_" LAZYLOC_CREATE_SIFT_MATCHER);
using Points = std::vector<Eigen::Vector2d>;
colmap::TwoViewGeometry VerifyByColmap(const colmap::Camera& camera1, const Points& points1,
                                       const colmap::Camera& camera2, const Points& points2,
                                       const colmap::FeatureMatches& matches,
                                       const colmap::TwoViewGeometryOptions& options) __asm__("__real_" LAZYLOC_VERIFY);
colmap::TwoViewGeometry Verify(const colmap::Camera& camera1, const Points& points1, const colmap::Camera& camera2,
                               const Points& points2, const colmap::FeatureMatches& matches,
                               const colmap::TwoViewGeometryOptions& options) __asm__("__wrap_" LAZYLOC_VERIFY);

Extractor CreateExtractor(const ExtractionOptions& options) {
  const auto plain = match_descriptors && !options.use_gpu ? PlainSiftOptions(options) : std::nullopt;
  return plain ? std::make_unique<PlainSiftExtractor>(*plain) : CreateExtractorByColmap(options);
}

Matcher CreateMatcher(const MatchingOptions& options) {
  const MatchingOptions defaults;
  const bool is_plain =
      options.max_ratio == defaults.max_ratio && options.max_distance == defaults.max_distance && options.cross_check;
  Matcher colmaps = CreateMatcherByColmap(options);
  if (!match_descriptors || options.use_gpu || !is_plain) return colmaps;
  return std::make_unique<PlainSiftMatcher>(std::move(colmaps));
}

// COLMAP seeds a thread once, so that the result for a pair depends on the pairs that its thread has verified before.
colmap::TwoViewGeometry Verify(const colmap::Camera& camera1, const Points& points1, const colmap::Camera& camera2,
                               const Points& points2, const colmap::FeatureMatches& matches,
                               const colmap::TwoViewGeometryOptions& options) {
  if (match_descriptors) colmap::SetPRNGSeed();
  return VerifyByColmap(camera1, points1, camera2, points2, matches, options);
}
#endif

const char* const kExtractionUseGpuOption = "--SiftExtraction.use_gpu";
const char* const kMatchingUseGpuOption = "--SiftMatching.use_gpu";

void ReplaceSift(Matches (*match)(const Descriptors&, const Descriptors&)) { match_descriptors = match; }

}  // namespace lazyloc
