#include "colmap_lazyloc/bridge/reconstruction_building.h"

#include <utility>

namespace lazyloc {

void AddCamera(const colmap::Camera& camera, colmap::Reconstruction* reconstruction) {
  reconstruction->AddCamera(camera);
}

void AddPosedImage(colmap::Image image, const colmap::Rigid3d& cam_from_world, colmap::Reconstruction* reconstruction) {
  const colmap::image_t image_id = image.ImageId();
  image.CamFromWorld() = cam_from_world;
  reconstruction->AddImage(std::move(image));
  reconstruction->RegisterImage(image_id);
}

void AddMatches(uint32_t image_id1, uint32_t image_id2, const colmap::FeatureMatches& matches,
                colmap::CorrespondenceGraph* graph) {
  graph->AddCorrespondences(image_id1, image_id2, matches);
}

}  // namespace lazyloc
