#include "colmap_lazyloc/features/extracted_features.h"

#include <system_error>
#include <utility>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {

namespace fs = std::filesystem;

ExtractedFeatures::ExtractedFeatures(const FeatureMethod& method, fs::path image_path, fs::path folder)
    : method_(method), image_path_(std::move(image_path)), kept_(std::move(folder)) {}

bool ExtractedFeatures::HasFile(const std::string& image_name) const {
  std::error_code ignored;
  return fs::is_regular_file(image_path_ / image_name, ignored);
}

std::optional<Features> ExtractedFeatures::Get(const std::string& image_name, const Camera& camera) const {
  if (!HasFile(image_name)) return std::nullopt;
  const fs::path image_path = image_path_ / image_name;
  const std::string key = Format("%s %zu x %zu ", method_.Key().c_str(), size_t{camera.width}, size_t{camera.height});
  return kept_.Get(image_name, image_path, key, method_.Type(), [&]() -> std::optional<Features> {
    const std::optional<PhotoFile> file = PhotoFile::Read(image_path, method_.NeedsColours());
    if (!file || file->Properties().width != camera.width || file->Properties().height != camera.height) {
      return std::nullopt;
    }
    IdleThreads none(0);  // because each image has a thread
    return method_.Extract(*file, MeanFocalLength(camera), &none);
  });
}

}  // namespace lazyloc
