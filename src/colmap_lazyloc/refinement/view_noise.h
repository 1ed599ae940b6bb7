#pragma once

#include <vector>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Sets each view's noise_px to the robust standard deviation (by the median) that the tracks' reprojection errors show in
// it, corrected for what each track's point has taken up. Views with few tracks lean on the others. Database poses from
// SLAM or a depth camera are off by pixels, those of a careful reconstruction by a fraction of one: no fixed scale
// serves both. Never below min_noise_px.
void EstimateViewNoise(const std::vector<Track>& tracks, double min_noise_px, std::vector<View>* views);

}  // namespace lazyloc
