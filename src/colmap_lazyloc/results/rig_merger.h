#pragma once

#include "colmap_lazyloc/results/model_merger.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Copies the model's rigs and frames, bit for bit, but without images that are not in `merged` (sorted by id) and
// without frames that have no image left, because COLMAP 4 refuses frames whose images are missing.
void KeepRigs(const Model& model, MergedModel* merged);

// Gives an image a frame of its own in the rig of its camera, or in a new rig of this camera alone if no rig has a pose
// for it. The new ids are the image's and the camera's if these are free.
void AddFrameOfOneImage(const ModelImage& image, MergedModel* merged);

}  // namespace lazyloc
