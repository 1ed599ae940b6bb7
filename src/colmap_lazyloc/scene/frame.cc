#include "colmap_lazyloc/scene/frame.h"

namespace lazyloc {

std::vector<Rigid3d> CamsFromWorld(const PosedImages& posed) {
  std::vector<Rigid3d> cams_from_world;
  cams_from_world.reserve(posed.images.size());
  for (const Image& image : posed.images) {
    cams_from_world.push_back(CamFromWorld(image, posed.frames[image.frame].frame_from_world));
  }
  return cams_from_world;
}

}  // namespace lazyloc
