#include "colmap_lazyloc/bridge/sift_extractor.h"

#include "colmap_lazyloc/bridge/sift.h"

namespace lazyloc {
namespace {

bool is_replaced = false;

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

}  // namespace

#ifdef LAZYLOC_CREATE_SIFT
using Extractor = std::unique_ptr<colmap::FeatureExtractor>;

// COLMAP's function, and the one that the linker puts into its place.
Extractor CreateSiftByColmap(const colmap::SiftExtractionOptions& options) __asm__("__real_" LAZYLOC_CREATE_SIFT);
Extractor CreateSift(const colmap::SiftExtractionOptions& options) __asm__("__wrap_" LAZYLOC_CREATE_SIFT);

Extractor CreateSift(const colmap::SiftExtractionOptions& options) {
  const auto plain = is_replaced && !options.use_gpu ? PlainSiftOptions(options) : std::nullopt;
  return plain ? std::make_unique<PlainSiftExtractor>(*plain) : CreateSiftByColmap(options);
}
#endif

const char* const kUseGpuOption = "--SiftExtraction.use_gpu";

void ReplaceSiftExtractor() { is_replaced = true; }

}  // namespace lazyloc
