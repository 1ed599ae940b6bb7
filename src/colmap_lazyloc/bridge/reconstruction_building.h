#pragma once

#include <cstdint>

#include <colmap/scene/correspondence_graph.h>
#include <colmap/scene/reconstruction.h>

namespace lazyloc {

// Add a camera, and an image with a pose, to a reconstruction: in COLMAP 4 with a rig of one camera, and a frame of one
// image.
void AddCamera(const colmap::Camera& camera, colmap::Reconstruction* reconstruction);
void AddPosedImage(colmap::Image image, const colmap::Rigid3d& cam_from_world, colmap::Reconstruction* reconstruction);

void AddMatches(uint32_t image_id1, uint32_t image_id2, const colmap::FeatureMatches& matches,
                colmap::CorrespondenceGraph* graph);

}  // namespace lazyloc
