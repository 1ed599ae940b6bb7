#pragma once

#include <vector>

#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Returns the weights of a Gaussian window of 2n + 1 pixels with n = ceil(4 * stddev_px), computed like VLFeat's.
std::vector<float> GaussianWeights(double stddev_px);

// Convolves an image with weights along its columns and its rows; the image continues with its border. image, smoothed:
// width * height values, row by row, not the same. Each value is the same on every processor, because its terms are
// added one by one in the order of the pixels. Uses idle threads, too.
void Smooth(const float* image, int width, int height, const std::vector<float>& weights, IdleThreads* idle_threads,
            float* smoothed);

// Does the same for the rows in [begin, end) alone. smoothed: these rows.
void SmoothRows(const float* image, int width, int height, const std::vector<float>& weights, int begin, int end,
                float* smoothed);

}  // namespace lazyloc
