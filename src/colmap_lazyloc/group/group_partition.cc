#include "colmap_lazyloc/group/group_partition.h"

#include <algorithm>

namespace lazyloc {

QueryGroup SelectImages(const QueryGroup& group, const std::vector<int>& images) {
  QueryGroup selected;
  selected.has_rig_scale = group.has_rig_scale;
  std::vector<int> new_index(group.images.size(), -1), num_images;
  int last_frame = -1;
  for (const int i : images) {
    if (group.images[i].frame != last_frame) {
      last_frame = group.images[i].frame;
      selected.frame_names.push_back(group.frame_names[last_frame]);
      num_images.push_back(0);
    }
    new_index[i] = static_cast<int>(selected.images.size());
    selected.images.push_back(group.images[i]);
    selected.images.back().frame = static_cast<int>(num_images.size()) - 1;
    ++num_images.back();
  }
  for (const QueryImage& image : selected.images) {
    if (num_images[image.frame] == 1) selected.frame_names[image.frame].clear();
  }
  for (const QueryPair& pair : group.query_pairs) {
    if (new_index[pair.query] < 0 || new_index[pair.other] < 0) continue;
    selected.query_pairs.push_back({new_index[pair.query], new_index[pair.other], pair.images});
  }
  return selected;
}

std::vector<int> ImagesOfFrames(const QueryGroup& group, const std::vector<int>& frames) {
  std::vector<int> images;
  for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
    if (std::count(frames.begin(), frames.end(), group.images[i].frame) > 0) images.push_back(i);
  }
  return images;
}

}  // namespace lazyloc
