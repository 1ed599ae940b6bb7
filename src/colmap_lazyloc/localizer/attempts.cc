#include "colmap_lazyloc/localizer/attempts.h"

#include <algorithm>

namespace lazyloc {

std::vector<Attempt> FurtherAttempts(const QuerySource& source, const GroupInput& input, const Attempt& first,
                                     const LoadedGroup& loaded) {
  std::vector<Attempt> attempts;
  const auto add = [&]() -> Attempt& {
    attempts.push_back(first);
    attempts.back().writes_matches = false;
    return attempts.back();
  };
  const std::vector<QueryImage>& images = loaded.group.images;
  const bool has_shared_camera = std::any_of(images.begin(), images.end(), [](const QueryImage& image) {
    return image.problem.intrinsics_origin == IntrinsicsOrigin::JOINT;
  });
  if (has_shared_camera) add().shared_cameras = nullptr;
  if (source.HasFurtherFeatures(loaded)) add().compares_all_features = true;
  if (source.HasFallback(input)) add().uses_fallback_features = true;
  return attempts;
}

}  // namespace lazyloc
