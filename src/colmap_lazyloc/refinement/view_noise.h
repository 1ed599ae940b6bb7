#pragma once

#include <vector>

#include "colmap_lazyloc/scene/track.h"

namespace lazyloc {

// Sets each view's noise_px to the robust standard deviation (by the median) that the tracks' reprojection errors show
// in it, corrected for what each track's point has taken up. Views with few tracks lean on the others. Database poses
// from SLAM or a depth camera are off by pixels, those of a careful reconstruction by a fraction of one: no fixed scale
// serves both. Never below min_noise_px.
void EstimateViewNoise(const std::vector<Track>& tracks, double min_noise_px, std::vector<View>* views);

// How many times the variance of the image points of others those of points that only one database image sees have, for
// what their views' noise lets expect; at least 1, and nearer to it the fewer they are. Wrong matches along epipolar
// lines, of like windows say, are found out where several database images see a point; where one does, they show here.
double MeasureSingleViewSpread(const std::vector<Track>& tracks, const std::vector<View>& views);

}  // namespace lazyloc
