#include "colmap_lazyloc/bridge/reconstruction_building.h"

#include <utility>

namespace lazyloc {

void AddCamera(const colmap::Camera& camera, colmap::Reconstruction* reconstruction) {
  reconstruction->AddCameraWithTrivialRig(camera);
}

void AddPosedImage(colmap::Image image, const colmap::Rigid3d& cam_from_world, colmap::Reconstruction* reconstruction) {
  reconstruction->AddImageWithTrivialFrame(std::move(image), cam_from_world);
}

void AddMatches(uint32_t image_id1, uint32_t image_id2, const colmap::FeatureMatches& matches,
                colmap::CorrespondenceGraph* graph) {
  colmap::TwoViewGeometry geometry;
  geometry.config = colmap::TwoViewGeometry::CALIBRATED;
  geometry.inlier_matches = matches;
  graph->AddTwoViewGeometry(image_id1, image_id2, std::move(geometry));
}

}  // namespace lazyloc
