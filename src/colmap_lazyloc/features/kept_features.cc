#include "colmap_lazyloc/features/kept_features.h"

#include <array>
#include <cinttypes>
#include <cstring>
#include <system_error>
#include <type_traits>

#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/files/record_file.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

static_assert(std::is_trivially_copyable_v<Keypoint>);

// Returns the first record of a file; an empty one if there is none, or if the disk is damaged.
std::string ReadRecord(const fs::path& path) {
  try {
    RecordReader reader(path);
    return reader.Next() ? reader.Record() : "";
  } catch (const InputError&) {
    return "";
  }
}

std::optional<Features> ReadKept(const fs::path& path, const std::string& key, FeatureType type) {
  const std::string record = ReadRecord(path);
  // After the key: the number of features and the bytes of a descriptor.
  std::array<uint32_t, 2> size = {};
  if (record.size() < key.size() + sizeof(size) || record.compare(0, key.size(), key) != 0) return std::nullopt;
  std::memcpy(size.data(), record.data() + key.size(), sizeof(size));
  const size_t keypoint_bytes = size[0] * sizeof(Keypoint), descriptor_bytes = size_t{size[0]} * size[1];
  if (record.size() != key.size() + sizeof(size) + keypoint_bytes + descriptor_bytes) return std::nullopt;
  Features features;
  features.type = type;
  features.keypoints.resize(size[0]);
  features.descriptors.resize(size[0], size[1]);
  if (size[0] == 0) return features;
  const char* const keypoints = record.data() + key.size() + sizeof(size);
  std::memcpy(features.keypoints.data(), keypoints, keypoint_bytes);
  std::memcpy(features.descriptors.data(), keypoints + keypoint_bytes, descriptor_bytes);
  return features;
}

void Keep(const fs::path& folder, const std::string& name, const std::string& key, const Features& features) {
  std::string record = key;
  const std::array<uint32_t, 2> size = {static_cast<uint32_t>(features.descriptors.rows()),
                                        static_cast<uint32_t>(features.descriptors.cols())};
  record.append(reinterpret_cast<const char*>(size.data()), sizeof(size));
  record.append(reinterpret_cast<const char*>(features.keypoints.data()), features.keypoints.size() * sizeof(Keypoint));
  record.append(reinterpret_cast<const char*>(features.descriptors.data()),
                static_cast<size_t>(features.descriptors.size()));
  try {
    std::error_code ignored;
    fs::create_directory(folder, ignored);
    const fs::path staged = folder / (name + ".new");
    for (const fs::path& path : {staged, folder / name}) fs::remove(path, ignored);  // damaged, even an empty folder
    RecordWriter(staged).Append(record);
    fs::rename(staged, folder / name, ignored);
  } catch (const InputError&) {
    // Goes on without keeping them: the next run extracts them again.
  }
}

}  // namespace

std::optional<Features> KeptFeatures::Get(const std::string& image_name, const fs::path& image_path,
                                          const std::string& key, FeatureType type, const Extract& extract) const {
  if (folder_.empty()) return extract();
  const std::string name = Format("%016" PRIx64, Hash64(image_name));
  const std::string full_key = key + FileContent(image_path) + '\n';
  if (std::optional<Features> kept = ReadKept(folder_ / name, full_key, type)) return kept;
  std::optional<Features> features = extract();
  if (features) Keep(folder_, name, full_key, *features);
  return features;
}

}  // namespace lazyloc
