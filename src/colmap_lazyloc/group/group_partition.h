#pragma once

#include <vector>

#include "colmap_lazyloc/scene/localization_problem.h"

namespace lazyloc {

// Returns the group of some of its images (ascending indices), with the query pairs among them. An image that is left
// alone in its frame becomes a single image.
QueryGroup SelectImages(const QueryGroup& group, const std::vector<int>& images);

// Returns the images of the given frames.
std::vector<int> ImagesOfFrames(const QueryGroup& group, const std::vector<int>& frames);

}  // namespace lazyloc
