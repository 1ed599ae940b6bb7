#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <sstream>
#include <system_error>

#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/io/record_archive.h"
#include "colmap_lazyloc/io/run_manifest.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {

namespace fs = std::filesystem;

template <typename Archive>
void serialize(Archive& archive, ModelImage& image) {
  auto& [image_id, camera_id, name, cam_from_world] = image;
  archive(image_id, camera_id, name, cam_from_world);
}

template <typename Archive>
void serialize(Archive& archive, Sensor& sensor) {
  auto& [type, sensor_id] = sensor;
  archive(type, sensor_id);
}

template <typename Archive>
void serialize(Archive& archive, RigSensor& sensor) {
  auto& [own_sensor, sensor_from_rig] = sensor;
  archive(own_sensor, sensor_from_rig);
}

template <typename Archive>
void serialize(Archive& archive, Rig& rig) {
  auto& [rig_id, reference, others] = rig;
  archive(rig_id, reference, others);
}

template <typename Archive>
void serialize(Archive& archive, FrameData& data) {
  auto& [sensor, data_id] = data;
  archive(sensor, data_id);
}

template <typename Archive>
void serialize(Archive& archive, ModelFrame& frame) {
  auto& [frame_id, rig_id, rig_from_world, data] = frame;
  archive(frame_id, rig_id, rig_from_world, data);
}

namespace {

constexpr uint64_t kMaxNumBytesRead = 16 << 20, kPieceSize = 64 << 10;

std::string Hex(uint64_t value) { return Format("%016llx", static_cast<unsigned long long>(value)); }

// Adds the bytes of a file, or of pieces of it. Returns its size.
uint64_t AddFile(const fs::path& path, Crc64* crc) {
  std::ifstream file(path, std::ios::binary);
  std::error_code error;
  const uint64_t size = fs::file_size(path, error);
  if (!file || error) throw InputError(path.string() + ": cannot be read");
  constexpr uint64_t kNumPieces = kMaxNumBytesRead / kPieceSize;
  const uint64_t step = size <= kMaxNumBytesRead ? kPieceSize : (size - kPieceSize) / (kNumPieces - 1);
  std::string piece(kPieceSize, '\0');
  for (uint64_t offset = 0; offset < size; offset += step) {
    file.seekg(static_cast<std::streamoff>(offset));
    file.read(piece.data(), static_cast<std::streamsize>(std::min(kPieceSize, size - offset)));
    crc->Add({piece.data(), static_cast<size_t>(file.gcount())});
  }
  return size;
}

template <typename T>
void AddValue(const T& value, Crc64* crc) {
  std::ostringstream stream;
  cereal::PortableBinaryOutputArchive archive(stream);
  archive(value);
  crc->Add(stream.str());
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
  Crc64 crc;
  Fingerprint fingerprint;
  uint64_t num_bytes = 0;
  for (const fs::path& file : files) {
    const uint64_t size = AddFile(file, &crc);
    num_bytes += size;
    struct stat state {};
    if (size <= kMaxNumBytesRead || stat(file.c_str(), &state) != 0) continue;
    fingerprint.identity += std::to_string(state.st_dev) + ":" + std::to_string(state.st_ino) + " ";
    fingerprint.modified += Format("%lld.%09ld ", static_cast<long long>(state.st_mtim.tv_sec), state.st_mtim.tv_nsec);
  }
  fingerprint.content = std::to_string(num_bytes) + " bytes, " + Hex(crc.Value());
  return fingerprint;
}

Fingerprint FingerprintOf(const Model& model) {
  Crc64 crc;
  for (const auto& [camera_id, camera] : model.cameras) AddValue(camera, &crc);
  for (const ModelImage& image : model.images) AddValue(image, &crc);
  for (const auto& [rig_id, rig] : model.rigs) AddValue(rig, &crc);
  for (const auto& [frame_id, frame] : model.frames) AddValue(frame, &crc);
  return {std::to_string(model.images.size()) + " images, " + Hex(crc.Value()), "", ""};
}

}  // namespace lazyloc
