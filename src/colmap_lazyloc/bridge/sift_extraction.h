#pragma once

#include <cstdint>
#include <vector>

#include <colmap/feature/types.h>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Extracts the features that COLMAP extracts without affine shapes and domain-size pooling, faster. grey: width *
// height values, row by row. Keypoints are in pixels of the image. Uses idle threads, too; the result does not depend
// on them.
void ExtractPlainSift(const std::vector<uint8_t>& grey, int width, int height, const SiftExtractionOptions& options,
                      IdleThreads* idle_threads, colmap::FeatureKeypoints* keypoints, Descriptors* descriptors);

}  // namespace lazyloc
