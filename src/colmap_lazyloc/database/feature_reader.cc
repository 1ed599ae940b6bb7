#include "colmap_lazyloc/database/feature_reader.h"

#include <cstring>
#include <limits>
#include <string>

#include "colmap_lazyloc/database/stored_values.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr int64_t kMaxInt = std::numeric_limits<int>::max();

SqliteStatement PrepareDescriptors(const SqliteConnection& connection, const std::string& columns,
                                   const std::string& condition) {
  const std::set<std::string> names = connection.ColumnNames("descriptors");
  if (names.empty()) {
    throw InputError(connection.File().Path().string() + ": is not a COLMAP database: it has no table descriptors");
  }
  // Versions before COLMAP 4 have no column for the type.
  const std::string type = names.count("type") > 0 ? "type" : "0";
  return connection.Prepare("descriptors", "SELECT " + columns + ", cols, " + type + " FROM descriptors " + condition);
}

// Reads the type from columns 2 (cols) and 3 (type).
FeatureType ReadType(const SqliteRows& row) {
  const int64_t cols = row.Integer(2, 0, kMaxInt);
  const int64_t number = row.Integer(3, 0, static_cast<int64_t>(kEnumNames<FeatureType>.size()) - 1);
  const auto type = static_cast<FeatureType>(number);
  const bool has_known_length = type == FeatureType::SIFT || IsAliked(type);
  const int64_t element_size = type == FeatureType::SIFT ? 1 : sizeof(float);
  if (has_known_length ? cols != kDescriptorLength * element_size : cols % element_size != 0) {
    row.Fail(std::string("descriptors are not ") + EnumName(type) + "'s: they have " + std::to_string(cols) +
             " columns");
  }
  return type;
}

Descriptors ReadDescriptors(const SqliteRows& row) {
  const ByteSpan data = row.Blob(1);
  const int64_t num_rows = row.Integer(0, 0, kMaxInt), num_columns = row.Integer(2, 1, kMaxInt);
  if (data.size / num_columns != static_cast<size_t>(num_rows) || data.size % num_columns != 0) {
    row.Fail("descriptors have " + std::to_string(data.size) + " bytes for " + std::to_string(num_rows) + " x " +
             std::to_string(num_columns));
  }
  Descriptors descriptors(num_rows, num_columns);
  if (data.size > 0) std::memcpy(descriptors.data(), data.data, data.size);
  return descriptors;
}

}  // namespace

FeatureReader::FeatureReader(const std::filesystem::path& path)
    : connection_(path),
      counts_(PrepareDescriptors(connection_, "image_id, rows", "WHERE rows IS NOT 0")),
      keypoints_(connection_.Prepare("keypoints", "SELECT rows, cols, data FROM keypoints WHERE image_id = ?1")),
      descriptors_(PrepareDescriptors(connection_, "rows, data", "WHERE image_id = ?1")) {}

bool FeatureReader::HasGravity() const { return connection_.ColumnNames("pose_priors").count("gravity") > 0; }

DescriptorCounts FeatureReader::ReadDescriptorCounts(std::vector<std::string>* damages) const {
  DescriptorCounts counts;
  uint32_t image_id = 0;
  SqliteRows rows = counts_.Run({}, [&] { return ImageLabel(connection_, image_id); });
  while (rows.Next()) {
    try {
      image_id = 0;
      image_id = static_cast<uint32_t>(rows.Integer(0, 0, kMaxInt));
      const FeatureType type = ReadType(rows);
      const auto count = static_cast<size_t>(rows.Integer(1, 1, kMaxInt));
      if (counts.of_image.empty()) counts.type = type;
      if (type != counts.type) {
        throw InputError(Path().string() + ": has features of types " + EnumName(counts.type) + " and " +
                         EnumName(type) + ", but photos can be matched with one type only");
      }
      counts.of_image[image_id] = count;
    } catch (const DamagedRecordError& error) {
      if (damages != nullptr) damages->push_back(error.Damage());
    }
  }
  return counts;
}

std::vector<Keypoint> FeatureReader::ReadKeypoints(uint32_t image_id) const {
  SqliteRows rows = keypoints_.Run({image_id}, [this, image_id] { return ImageLabel(connection_, image_id); });
  std::vector<Keypoint> keypoints;
  while (rows.Next()) keypoints = ReadStoredKeypoints(rows);
  return keypoints;
}

Features FeatureReader::Read(uint32_t image_id) const {
  Features features;
  SqliteRows descriptor_rows =
      descriptors_.Run({image_id}, [this, image_id] { return ImageLabel(connection_, image_id); });
  while (descriptor_rows.Next()) {
    if (descriptor_rows.Integer(0, 0, kMaxInt) == 0) continue;
    features.type = ReadType(descriptor_rows);
    features.descriptors = ReadDescriptors(descriptor_rows);
  }
  if (features.descriptors.rows() == 0) return features;
  features.keypoints = ReadKeypoints(image_id);
  if (features.keypoints.size() != static_cast<size_t>(features.descriptors.rows())) {
    descriptor_rows.Fail("has " + std::to_string(features.keypoints.size()) + " keypoints, but " +
                         std::to_string(features.descriptors.rows()) + " descriptors");
  }
  return features;
}

}  // namespace lazyloc
