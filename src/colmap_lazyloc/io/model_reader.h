#pragma once

#include <filesystem>

#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Reads cameras and images of a COLMAP model folder (cameras.bin and images.bin, or the .txt pair; binary
// wins where both are there, as in COLMAP), and its rigs and frames where it has any. Image points and points3D are
// skipped, and need not exist.
// Throws InputError, one line naming the file, for a missing, truncated or foreign file, a camera model that the
// linked COLMAP does not know, parameters that cannot be, a pose with NaN or a zero quaternion, duplicate
// names or ids, an image whose camera is missing, and a model without a posed image.
Model ReadModel(const std::filesystem::path& path);

}  // namespace lazyloc
