#pragma once

#include <vector>

#include "colmap_lazyloc/scene/frame.h"
#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Returns the noise of each image in pixels: the robust standard deviation (from the median) of the tracks'
// reprojection errors, corrected for the degrees of freedom that each track's point takes up. Shrunk (in log scale)
// towards the median over all database images, with the weight of 20 tracks. At least min_noise_px. Estimated, because
// no constant serves all databases: poses from SLAM or a depth camera are off by pixels, those of a careful
// reconstruction by a fraction of one. Returns the present noise if no track has more than two observations.
std::vector<double> EstimateImageNoise(const PosedImages& posed, const std::vector<Track>& tracks, double min_noise_px);

// Returns the ratio of normalised residual variances: tracks with one database frame over tracks with several. At least
// 1; shrunk towards 1 if there are few such tracks. False matches along epipolar lines (of repeated windows, for
// example) are detected if several database frames see a point; if one does, they show in this ratio only. The images
// of a rig frame count as one, because the error of its pose is common to them.
double MeasureSingleImageNoiseRatio(const PosedImages& posed, const std::vector<Track>& tracks);

}  // namespace lazyloc
