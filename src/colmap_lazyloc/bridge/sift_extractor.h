#pragma once

namespace lazyloc {

// Lets COLMAP's feature_extractor of this process extract SIFT features by ExtractPlainSift, if its options allow it.
// Only for the colmap program: its link replaces COLMAP's function that makes an extractor.
void ReplaceSiftExtractor();

// Name of the option of feature_extractor that switches the GPU.
extern const char* const kUseGpuOption;

}  // namespace lazyloc
