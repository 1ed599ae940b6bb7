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
    descriptors->type = colmap::FeatureExtractorType::SIFT;
    ExtractPlainSift(GreyValues(bitmap), bitmap.Width(), bitmap.Height(), options_, &none, keypoints,
                     &descriptors->data);
    return true;
  }

 private:
  const SiftExtractionOptions options_;
};

class PlainSiftMatcher : public colmap::FeatureMatcher {
 public:
  explicit PlainSiftMatcher(std::unique_ptr<colmap::FeatureMatcher> colmaps) : colmaps_(std::move(colmaps)) {}

  void Match(const Image& image1, const Image& image2, colmap::FeatureMatches* matches) override {
    matches->clear();
    for (const lazyloc::Match& match : match_descriptors(image1.descriptors->data, image2.descriptors->data)) {
      matches->emplace_back(match.query_point, match.other_point);
    }
  }

  void MatchGuided(double max_error, const Image& image1, const Image& image2,
                   colmap::TwoViewGeometry* geometry) override {
    colmaps_->MatchGuided(max_error, image1, image2, geometry);
  }

 private:
  const std::unique_ptr<colmap::FeatureMatcher> colmaps_;
};

}  // namespace

#ifdef LAZYLOC_CREATE_SIFT_EXTRACTOR
using Extractor = std::unique_ptr<colmap::FeatureExtractor>;
using Matcher = std::unique_ptr<colmap::FeatureMatcher>;
using ExtractionOptions = colmap::FeatureExtractionOptions;
using MatchingOptions = colmap::FeatureMatchingOptions;

// COLMAP's functions, and those that the linker puts into their places.
Extractor CreateExtractorByColmap(const ExtractionOptions& options) __asm__("__real_" LAZYLOC_CREATE_SIFT_EXTRACTOR);
Extractor CreateExtractor(const ExtractionOptions& options) __asm__("__wrap_" LAZYLOC_CREATE_SIFT_EXTRACTOR);
Matcher CreateMatcherByColmap(const MatchingOptions& options) __asm__("__real_" LAZYLOC_CREATE_SIFT_MATCHER);
Matcher CreateMatcher(const MatchingOptions& options) __asm__("__wrap_" LAZYLOC_CREATE_SIFT_MATCHER);
using Points = std::vector<Eigen::Vector2d>;
colmap::TwoViewGeometry VerifyByColmap(const colmap::Camera& camera1, const Points& points1,
                                       const colmap::Camera& camera2, const Points& points2,
                                       colmap::FeatureMatches matches,
                                       const colmap::TwoViewGeometryOptions& options) __asm__("__real_" LAZYLOC_VERIFY);
colmap::TwoViewGeometry Verify(const colmap::Camera& camera1, const Points& points1, const colmap::Camera& camera2,
                               const Points& points2, colmap::FeatureMatches matches,
                               const colmap::TwoViewGeometryOptions& options) __asm__("__wrap_" LAZYLOC_VERIFY);

Extractor CreateExtractor(const ExtractionOptions& options) {
  const auto plain = match_descriptors && !options.use_gpu ? PlainSiftOptions(*options.sift) : std::nullopt;
  return plain ? std::make_unique<PlainSiftExtractor>(*plain) : CreateExtractorByColmap(options);
}

Matcher CreateMatcher(const MatchingOptions& options) {
  const colmap::SiftMatchingOptions defaults, &sift = *options.sift;
  const bool is_plain = options.type == colmap::FeatureMatcherType::SIFT_BRUTEFORCE &&
                        sift.max_ratio == defaults.max_ratio && sift.max_distance == defaults.max_distance &&
                        sift.cross_check;
  Matcher colmaps = CreateMatcherByColmap(options);
  if (!match_descriptors || options.use_gpu || !is_plain) return colmaps;
  return std::make_unique<PlainSiftMatcher>(std::move(colmaps));
}

// COLMAP seeds a thread once, so that the result for a pair depends on the pairs that its thread has verified before.
colmap::TwoViewGeometry Verify(const colmap::Camera& camera1, const Points& points1, const colmap::Camera& camera2,
                               const Points& points2, colmap::FeatureMatches matches,
                               const colmap::TwoViewGeometryOptions& options) {
  if (match_descriptors) colmap::SetPRNGSeed();
  return VerifyByColmap(camera1, points1, camera2, points2, std::move(matches), options);
}
#endif

const char* const kExtractionUseGpuOption = "--FeatureExtraction.use_gpu";
const char* const kMatchingUseGpuOption = "--FeatureMatching.use_gpu";

void ReplaceSift(Matches (*match)(const Descriptors&, const Descriptors&)) { match_descriptors = match; }

}  // namespace lazyloc
