#include "colmap_lazyloc/database/stored_values.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <limits>

#include <Eigen/Geometry>

#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr int64_t kMaxInt = std::numeric_limits<int>::max();

// Reads a number as COLMAP writes it: in the byte order of the machine, which is little endian everywhere.
template <typename T>
T NumberAt(const ByteSpan& blob, size_t offset) {
  T value;
  std::memcpy(&value, blob.data + offset, sizeof(T));
  return value;
}

// A table of four-byte numbers, stored in the columns rows, cols and data (0 to 2 of the statement).
struct NumberTable {
  size_t num_rows = 0;
  size_t num_cols = 0;
  ByteSpan data;

  template <typename T>
  T At(size_t row, size_t col) const {
    static_assert(sizeof(T) == 4);
    return NumberAt<T>(data, 4 * (row * num_cols + col));
  }
};

NumberTable ReadNumberTable(const SqliteRows& row, std::initializer_list<size_t> valid_num_cols) {
  NumberTable table;
  table.num_rows = static_cast<size_t>(row.Integer(0, 0, kMaxInt));
  table.num_cols = static_cast<size_t>(row.Integer(1, 0, kMaxInt));
  table.data = row.Blob(2);
  const bool is_valid = std::count(valid_num_cols.begin(), valid_num_cols.end(), table.num_cols) > 0;
  if (table.num_rows > 0 && !is_valid) row.Fail("has " + std::to_string(table.num_cols) + " columns");
  if (table.data.size != 4 * table.num_rows * (is_valid ? table.num_cols : 0)) {
    row.Fail("data has " + std::to_string(table.data.size) + " bytes for " + std::to_string(table.num_rows) + " x " +
             std::to_string(table.num_cols) + " numbers");
  }
  return table;
}

// Reads N numbers. Returns nullopt if they are unset: NULL or an empty blob (4.x), or not finite (3.x inverts an H of
// zeros when it exchanges the images).
template <int N>
std::optional<std::array<double, N>> ReadNumbers(const SqliteRows& row, int column) {
  const ByteSpan blob = row.Blob(column);
  if (blob.size == 0) return std::nullopt;
  if (blob.size != N * sizeof(double)) {
    row.Fail(row.ColumnName(column) + " has " + std::to_string(blob.size) + " bytes instead of " +
             std::to_string(N * sizeof(double)));
  }
  std::array<double, N> values;
  std::memcpy(values.data(), blob.data, blob.size);
  const bool is_finite = std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
  return is_finite ? std::make_optional(values) : std::nullopt;
}

bool HasFiniteShape(const Keypoint& keypoint) {
  return std::isfinite(keypoint.a11) && std::isfinite(keypoint.a12) && std::isfinite(keypoint.a21) &&
         std::isfinite(keypoint.a22);
}

}  // namespace

std::string ImageLabel(const SqliteConnection& connection, uint32_t image_id) {
  std::string label = "image " + std::to_string(image_id);
  try {
    const SqliteStatement name = connection.Prepare("images", "SELECT name FROM images WHERE image_id = ?1");
    SqliteRows rows = name.Run({image_id});
    if (rows.Next()) label += " (" + rows.Text(0) + ")";
  } catch (const DamagedRecordError&) {
    // The label is for a message about another record.
  }
  return label;
}

std::vector<double> ReadCameraParams(const SqliteRows& row, const ByteSpan& blob) {
  if (blob.size % sizeof(double) != 0) row.Fail("camera parameters of " + std::to_string(blob.size) + " bytes");
  std::vector<double> values(blob.size / sizeof(double));
  for (size_t i = 0; i < values.size(); ++i) values[i] = NumberAt<double>(blob, i * sizeof(double));
  return values;
}

std::vector<Keypoint> ReadStoredKeypoints(const SqliteRows& row) {
  const NumberTable table = ReadNumberTable(row, {2, 4, 6});
  std::vector<Keypoint> keypoints(table.num_rows);
  for (size_t i = 0; i < keypoints.size(); ++i) {
    Keypoint& keypoint = keypoints[i];
    keypoint.x = table.At<float>(i, 0);
    keypoint.y = table.At<float>(i, 1);
    if (!std::isfinite(keypoint.x) || !std::isfinite(keypoint.y)) {
      row.Fail("keypoint " + std::to_string(i) + " is not finite");
    }
    Keypoint shaped = keypoint;
    if (table.num_cols == 4) {
      const float scale = table.At<float>(i, 2), orientation = table.At<float>(i, 3);
      shaped.a11 = shaped.a22 = scale * std::cos(orientation);
      shaped.a21 = scale * std::sin(orientation);
      shaped.a12 = -shaped.a21;
    } else if (table.num_cols == 6) {
      shaped.a11 = table.At<float>(i, 2);
      shaped.a12 = table.At<float>(i, 3);
      shaped.a21 = table.At<float>(i, 4);
      shaped.a22 = table.At<float>(i, 5);
    }
    // Keeps the default for a shape that is not finite, because scales are sorted, and localization needs no shape.
    if (HasFiniteShape(shaped)) keypoint = shaped;
  }
  return keypoints;
}

Matches ReadStoredMatches(const SqliteRows& row) {
  const NumberTable table = ReadNumberTable(row, {2});
  Matches matches(table.num_rows);
  for (size_t i = 0; i < matches.size(); ++i) matches[i] = {table.At<uint32_t>(i, 1), table.At<uint32_t>(i, 0)};
  return matches;
}

std::optional<Eigen::Matrix3d> ReadMatrix(const SqliteRows& row, int column) {
  const auto numbers = ReadNumbers<9>(row, column);
  if (!numbers) return std::nullopt;
  const Eigen::Matrix3d matrix = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(numbers->data());
  const bool is_set = !matrix.isZero(0) && !matrix.isIdentity(0);
  return is_set ? std::make_optional(matrix) : std::nullopt;
}

std::optional<Rigid3d> ReadPose(const SqliteRows& row, int qvec_column, int tvec_column) {
  const auto wxyz = ReadNumbers<4>(row, qvec_column);
  const auto translation = ReadNumbers<3>(row, tvec_column);
  if (!wxyz || !translation) return std::nullopt;
  const auto [w, x, y, z] = *wxyz;
  const Rigid3d pose{Eigen::Quaterniond(w, x, y, z).normalized(), Eigen::Vector3d(translation->data())};
  const bool has_rotation = !pose.rotation.vec().isZero(0);
  if (!has_rotation && (w == 0 || pose.translation.isZero(0))) return std::nullopt;
  return pose;
}

std::optional<Rigid3d> ReadSensorFromRig(const SqliteRows& row, int column) {
  const auto numbers = ReadNumbers<7>(row, column);
  if (!numbers) return std::nullopt;
  const auto [w, x, y, z, tx, ty, tz] = *numbers;
  const Rigid3d sensor_from_rig{Eigen::Quaterniond(w, x, y, z).normalized(), {tx, ty, tz}};
  if (!sensor_from_rig.rotation.coeffs().allFinite()) row.Fail(row.ColumnName(column) + " has no rotation");
  return sensor_from_rig;
}

std::optional<Camera> ReadSerializedCamera(const SqliteRows& row, int column) {
  constexpr size_t kParamsOffset = 33;
  const ByteSpan blob = row.Blob(column);
  if (blob.size == 0) return std::nullopt;
  if (blob.size < kParamsOffset || NumberAt<uint64_t>(blob, 25) != (blob.size - kParamsOffset) / sizeof(double)) {
    row.Fail(row.ColumnName(column) + " is damaged");
  }
  Camera camera;
  camera.camera_id = NumberAt<uint32_t>(blob, 0);
  camera.model_id = NumberAt<int32_t>(blob, 4);
  camera.width = NumberAt<uint64_t>(blob, 8);
  camera.height = NumberAt<uint64_t>(blob, 16);
  camera.has_prior_focal_length = NumberAt<uint8_t>(blob, 24) != 0;
  camera.params = ReadCameraParams(row, {blob.data + kParamsOffset, blob.size - kParamsOffset});
  return camera;
}

}  // namespace lazyloc
