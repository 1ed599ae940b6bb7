#pragma once

#include "colmap_lazyloc/io/model_merger.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Takes over the model's rigs and frames, bit for bit, as far as their images are in `merged`: other images leave their
// frame, and a frame that has lost all its images goes. (COLMAP 4 refuses frames whose images are missing.)
void KeepRigs(const Model& model, MergedModel* merged);

// Gives an image a frame of its own, of the rig that its camera is of; where that rig does not say where on it the
// camera is, or there is none, of a new rig of this camera alone. New ids are the image's and the camera's where these
// are free.
void AddFrameOfOneImage(const ModelImage& image, MergedModel* merged);

}  // namespace lazyloc
