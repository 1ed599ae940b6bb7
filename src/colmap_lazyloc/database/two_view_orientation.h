#pragma once

#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/two_view_geometry.h"

namespace lazyloc {

// The same pair with query and database image exchanged. Exact but for H and the relative pose, whose inverses are
// rounded; left out where not finite (H singular).
TwoViewGeometry Inverted(const TwoViewGeometry& geometry);

// One form for a relative pose, whichever way round the database stores it: unit quaternion with w >= 0, translation of
// unit length (zero stays zero), every component a multiple of 2^-33 (about 1e-10).
// Why round: a stored pose and its stored inverse differ in the last bits, and which of the two a database holds hangs
// on its image ids, which must not reach the result. (A component within the last bits of the middle between two
// multiples can still go either way: about three poses in a million, by 1e-10.)
Rigid3d CanonicalRelativePose(const Rigid3d& cam2_from_cam1);

}  // namespace lazyloc
