#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <system_error>

#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/runs/record_archive.h"
#include "colmap_lazyloc/runs/run_manifest.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {

namespace fs = std::filesystem;

LAZYLOC_ARCHIVE(ModelImage, image_id, camera_id, name, cam_from_world)
LAZYLOC_ARCHIVE(Sensor, type, sensor_id)
LAZYLOC_ARCHIVE(RigSensor, own_sensor, sensor_from_rig)
LAZYLOC_ARCHIVE(Rig, rig_id, reference, others)
LAZYLOC_ARCHIVE(FrameData, sensor, data_id)
LAZYLOC_ARCHIVE(ModelFrame, frame_id, rig_id, rig_from_world, data)

namespace {

constexpr uint64_t kMaxNumBytesRead = 16 << 20, kPieceSize = 64 << 10;
constexpr uint64_t kTreePieceSize = 4 << 10;

std::string Hex(uint32_t value) { return Format("%08x", value); }

// Adds the bytes of a file of at most max_bytes, or of evenly spaced pieces of a larger one. Returns its size.
uint64_t AddFile(const fs::path& path, uint64_t piece_size, uint64_t max_bytes, uint32_t* crc) {
  std::ifstream file(path, std::ios::binary);
  std::error_code error;
  const uint64_t size = fs::file_size(path, error);
  if (!file || error) throw InputError(path.string() + ": cannot be read");
  const uint64_t num_pieces = max_bytes / piece_size;
  const uint64_t step = size <= max_bytes ? piece_size : (size - piece_size) / (num_pieces - 1);
  std::string piece(piece_size, '\0');
  for (uint64_t offset = 0; offset < size; offset += step) {
    file.seekg(static_cast<std::streamoff>(offset));
    file.read(piece.data(), static_cast<std::streamsize>(std::min(piece_size, size - offset)));
    *crc = Crc32({piece.data(), static_cast<size_t>(file.gcount())}, *crc);
  }
  return size;
}

// Adds what tells a file from others of the same content.
void AddState(const fs::path& path, Fingerprint* fingerprint) {
  struct stat state {};
  if (stat(path.c_str(), &state) != 0) return;
  fingerprint->identity += std::to_string(state.st_dev) + ":" + std::to_string(state.st_ino) + " ";
  fingerprint->modified += Format("%lld.%09ld ", static_cast<long long>(state.st_mtim.tv_sec), state.st_mtim.tv_nsec);
}

template <typename T>
void AddValue(const T& value, uint32_t* crc) {
  *crc = Crc32(Pack(value), *crc);
}

}  // namespace

bool Fingerprint::IsChanged(const Fingerprint& other) const {
  return content != other.content || (identity == other.identity && modified != other.modified);
}

Fingerprint FingerprintOf(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) return {};
  std::vector<fs::path> files = {path};
  if (fs::is_directory(path, ignored)) {
    files.clear();
    for (const fs::directory_entry& entry : fs::directory_iterator(path)) {
      if (entry.is_regular_file()) files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
  } else if (fs::exists(path.string() + "-wal", ignored)) {
    files.emplace_back(path.string() + "-wal");
  }
  uint32_t crc = 0;
  Fingerprint fingerprint;
  uint64_t num_bytes = 0;
  for (const fs::path& file : files) {
    const uint64_t size = AddFile(file, kPieceSize, kMaxNumBytesRead, &crc);
    num_bytes += size;
    if (size > kMaxNumBytesRead) AddState(file, &fingerprint);
  }
  fingerprint.content = std::to_string(num_bytes) + " bytes, " + Hex(crc);
  return fingerprint;
}

Fingerprint FingerprintOfTree(const fs::path& folder) {
  std::error_code ignored;
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder, ignored)) {
    if (entry.is_regular_file(ignored)) files.push_back(entry.path());
  }
  if (files.empty()) return {};
  std::sort(files.begin(), files.end());
  uint32_t crc = 0, identity = 0, modified = 0;
  uint64_t num_bytes = 0;
  for (const fs::path& file : files) {
    AddValue(fs::path(file).lexically_relative(folder).string(), &crc);
    const uint64_t size = AddFile(file, kTreePieceSize, 3 * kTreePieceSize, &crc);
    AddValue(size, &crc);
    num_bytes += size;
    Fingerprint state;
    AddState(file, &state);
    identity = Crc32(state.identity, identity);
    modified = Crc32(state.modified, modified);
  }
  return {std::to_string(num_bytes) + " bytes, " + Hex(crc), Hex(identity), Hex(modified)};
}

Fingerprint FingerprintOf(const Model& model) {
  uint32_t crc = 0;
  for (const auto& [camera_id, camera] : model.cameras) AddValue(camera, &crc);
  for (const ModelImage& image : model.images) AddValue(image, &crc);
  for (const auto& [rig_id, rig] : model.rigs) AddValue(rig, &crc);
  for (const auto& [frame_id, frame] : model.frames) AddValue(frame, &crc);
  return {std::to_string(model.images.size()) + " images, " + Hex(crc), "", ""};
}

}  // namespace lazyloc
