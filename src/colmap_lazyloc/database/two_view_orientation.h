#pragma once

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

// Exchanges the two images of a pair. This is exact except for H and the relative pose, whose inverses are rounded; a
// singular H is left out.
TwoViewGeometry Inverted(const TwoViewGeometry& geometry);

// Returns the same form of a relative pose for both orders of its images: unit quaternion with w >= 0, translation of
// unit length (zero stays zero), every component rounded to a multiple of 2^-33 (about 1e-10). It rounds because a
// stored pose and its stored inverse differ in the last bits, and which of the two a database stores depends on its
// image ids, which must not change the result. (A component within the last bits of the middle between two multiples
// can still be rounded either way: about three poses in a million, by 1e-10.)
Rigid3d CanonicalRelativePose(const Rigid3d& cam2_from_cam1);

}  // namespace lazyloc
