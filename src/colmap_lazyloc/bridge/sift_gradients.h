#pragma once

#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Sets magnitude and angle in [0, 2 pi] of each pixel's gradient, with VLFeat's approximations of the square root and
// the arc tangent. image: width * height values, row by row; gradients: twice as many. Uses idle threads, too.
void ComputeGradients(const float* image, int width, int height, IdleThreads* idle_threads, float* gradients);

}  // namespace lazyloc
