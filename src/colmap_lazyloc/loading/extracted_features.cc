#include "colmap_lazyloc/loading/extracted_features.h"

#include <cinttypes>
#include <cstring>
#include <system_error>
#include <type_traits>
#include <utility>

#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/files/record_file.h"
#include "colmap_lazyloc/files/staged_output.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

// Bytes of a keypoint and its descriptor in a file.
constexpr size_t kDescriptorBytes = kDescriptorLength * sizeof(float);
constexpr size_t kFeatureBytes = sizeof(Keypoint) + kDescriptorBytes;
static_assert(std::is_trivially_copyable_v<Keypoint>);

// Returns the size and the checksum of a file.
std::string ContentOf(const fs::path& path) {
  std::error_code ignored;
  return Format("%ju bytes %08x", fs::file_size(path, ignored), Crc32OfFile(path));
}

// Returns the first record of a file; an empty one if there is none, or if the disk is damaged.
std::string ReadRecord(const fs::path& path) {
  try {
    RecordReader reader(path);
    return reader.Next() ? reader.Record() : "";
  } catch (const InputError&) {
    return "";
  }
}

}  // namespace

ExtractedFeatures::ExtractedFeatures(const Aliked& aliked, fs::path image_path, fs::path folder)
    : aliked_(aliked), image_path_(std::move(image_path)), folder_(std::move(folder)) {
  const AlikedOptions& options = aliked.Options();
  extractor_ = Format("%s %d %d %d %s", EnumName(aliked.Type()), options.max_image_size, options.max_num_features,
                      static_cast<int>(options.has_full_contrast), ContentOf(aliked.ExtractorPath()).c_str());
}

bool ExtractedFeatures::HasFile(const std::string& image_name) const {
  std::error_code ignored;
  return fs::is_regular_file(image_path_ / image_name, ignored);
}

std::optional<Features> ExtractedFeatures::Get(const std::string& image_name, const Camera& camera) const {
  if (!HasFile(image_name)) return std::nullopt;
  const fs::path image_path = image_path_ / image_name, path = folder_ / Format("%016" PRIx64, Hash64(image_name));
  const std::string key = Format("%s %zu x %zu ", extractor_.c_str(), size_t{camera.width}, size_t{camera.height}) +
                          ContentOf(image_path) + '\n';
  if (std::optional<Features> kept = folder_.empty() ? std::nullopt : ReadKept(path, key)) return kept;
  const std::optional<PhotoFile> file = PhotoFile::Read(image_path, /*as_rgb=*/true);
  if (!file || file->Properties().width != camera.width || file->Properties().height != camera.height) {
    return std::nullopt;
  }
  Features features = aliked_.Extract(*file);
  if (!folder_.empty()) Keep(path, key, features);
  return features;
}

std::optional<Features> ExtractedFeatures::ReadKept(const fs::path& path, const std::string& key) const {
  const std::string record = ReadRecord(path);
  if (record.compare(0, key.size(), key) != 0 || (record.size() - key.size()) % kFeatureBytes != 0) return std::nullopt;
  const size_t num_features = (record.size() - key.size()) / kFeatureBytes;
  Features features;
  features.type = aliked_.Type();
  features.keypoints.resize(num_features);
  features.descriptors.resize(static_cast<Eigen::Index>(num_features), kDescriptorBytes);
  if (num_features == 0) return features;
  const char* const keypoints = record.data() + key.size();
  const size_t keypoint_bytes = num_features * sizeof(Keypoint);
  std::memcpy(features.keypoints.data(), keypoints, keypoint_bytes);
  std::memcpy(features.descriptors.data(), keypoints + keypoint_bytes, num_features * kDescriptorBytes);
  return features;
}

void ExtractedFeatures::Keep(const fs::path& path, const std::string& key, const Features& features) const {
  std::string record = key;
  record.append(reinterpret_cast<const char*>(features.keypoints.data()), features.keypoints.size() * sizeof(Keypoint));
  record.append(reinterpret_cast<const char*>(features.descriptors.data()),
                static_cast<size_t>(features.descriptors.size()));
  try {
    std::error_code ignored;
    fs::create_directory(folder_, ignored);
    StagedOutput staged(folder_);
    const std::string name = path.filename().string();
    RecordWriter(staged / name).Append(record);
    staged.Publish({name});
  } catch (const InputError&) {
    // Goes on without keeping them: the next run extracts them again.
  }
}

}  // namespace lazyloc
