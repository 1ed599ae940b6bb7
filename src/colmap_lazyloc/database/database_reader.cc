#include "colmap_lazyloc/database/database_reader.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "colmap_lazyloc/database/lru_cache.h"
#include "colmap_lazyloc/database/sqlite.h"
#include "colmap_lazyloc/database/stored_values.h"
#include "colmap_lazyloc/database/two_view_orientation.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

// COLMAP's limit of image ids, and the base of its pair ids: pair_id = image_id1 * kMaxNumImages + image_id2 with
// image_id1 < image_id2.
constexpr int64_t kMaxNumImages = std::numeric_limits<int32_t>::max();
constexpr int64_t kMaxInt = std::numeric_limits<int>::max();
constexpr int64_t kMaxInt64 = std::numeric_limits<int64_t>::max();
constexpr int64_t kMaxCameraId = std::numeric_limits<uint32_t>::max();

using Points = std::vector<Eigen::Vector2f>;  // in pixels, as COLMAP stores them

int64_t PairId(uint32_t image_id1, uint32_t image_id2) {
  LAZYLOC_CHECK(image_id1 != image_id2);
  return std::min(image_id1, image_id2) * kMaxNumImages + std::max(image_id1, image_id2);
}

std::vector<Eigen::Vector2d> InDouble(const Points& points) {
  std::vector<Eigen::Vector2d> in_double;
  in_double.reserve(points.size());
  for (const Eigen::Vector2f& point : points) in_double.emplace_back(point.cast<double>());
  return in_double;
}

// Checks that the tables and columns of every version exist. Returns the columns of two_view_geometries.
std::set<std::string> CheckTables(const SqliteConnection& connection) {
  const std::pair<std::string, std::vector<std::string>> required_columns[] = {
      {"cameras", {"camera_id", "model", "width", "height", "params", "prior_focal_length"}},
      {"images", {"image_id", "name", "camera_id"}},
      {"keypoints", {"image_id", "rows", "cols", "data"}},
      {"matches", {"pair_id", "rows", "cols", "data"}},
      {"two_view_geometries", {"pair_id", "rows", "cols", "data", "config"}},
  };
  std::set<std::string> columns;
  for (const auto& [table, required] : required_columns) {
    columns = connection.ColumnNames(table);
    const std::string prefix = connection.File().Path().string() + ": is not a COLMAP database: ";
    if (columns.empty()) throw InputError(prefix + "it has no table " + table);
    for (const std::string& column : required) {
      if (columns.count(column) == 0) throw InputError(prefix + "its table " + table + " has no column " + column);
    }
  }
  return columns;
}

SqliteStatement PrepareTwoViewGeometry(const SqliteConnection& connection) {
  const std::set<std::string> columns = CheckTables(connection);
  std::string sql = "SELECT rows, cols, data, config";
  for (const std::string column : {"E", "F", "H", "qvec", "tvec", "camera1", "camera2"}) {
    sql += ", " + (columns.count(column) > 0 ? column : "NULL");
  }
  return connection.Prepare("two_view_geometries", sql + " FROM two_view_geometries WHERE pair_id = ?1");
}

// Selects the pairs of image ?1 that have rows, or a damaged number of them. Pairs with it first are a range of keys,
// pairs with it second have one key for each other image, whose ids are given as JSON text, because one statement is
// faster than one for each key. No blob is read, because `rows` is stored before it.
struct PairSizeStatements {
  PairSizeStatements(const SqliteConnection& connection, const std::string& table)
      : with_image_first(connection.Prepare(table, "SELECT pair_id - ?1 * ?2, rows FROM " + table +
                                                       " WHERE pair_id > ?1 * ?2 + ?1 AND pair_id < (?1 + 1) * ?2"
                                                       " AND rows IS NOT 0")),
        with_image_second(connection.Prepare(table, "SELECT o.value, t.rows FROM json_each(?3) o CROSS JOIN " + table +
                                                        " t ON t.pair_id = o.value * ?2 + ?1"
                                                        " WHERE t.rows IS NOT 0")) {}

  SqliteStatement with_image_first, with_image_second;
};

// begin, end: at least one id.
std::string AsJson(std::vector<uint32_t>::const_iterator begin, std::vector<uint32_t>::const_iterator end) {
  std::string json;
  for (auto id = begin; id != end; ++id) json += (id == begin ? '[' : ',') + std::to_string(*id);
  return json + "]";
}

// A row of the table images.
struct ImageRow : DatabaseImage {  // without a name if that cannot be read
  std::string damage;              // empty if the row can be used
};

// image_id: receives the id, for messages.
ImageRow ReadImageRow(const SqliteRows& row, int64_t* image_id) {
  ImageRow image;
  try {
    *image_id = row.IntegerOrNothing(0, std::numeric_limits<int64_t>::min(), kMaxInt64).value_or(-1);
    const std::string name = row.Text(2);
    if (name.empty() || name.find_first_of(std::string("\n\r\0", 3)) != std::string::npos) {
      row.Fail("'" + name + "' is not the name of a file");
    }
    image.name = name;
    image.image_id = static_cast<uint32_t>(row.Integer(0, 0, kMaxNumImages - 1));
    image.camera_id = static_cast<uint32_t>(row.Integer(1, 0, kMaxCameraId));
  } catch (const DamagedRecordError& error) {
    image.damage = error.Damage();
  }
  return image;
}

}  // namespace

struct DatabaseReader::Impl {
  explicit Impl(const std::filesystem::path& path)
      : connection(path),
        two_view_geometry(PrepareTwoViewGeometry(connection)),  // checks the tables first
        images(connection.Prepare("images", "SELECT image_id, camera_id, name FROM images")),
        camera(connection.Prepare("cameras",
                                  "SELECT model, width, height, prior_focal_length, params FROM cameras"
                                  " WHERE camera_id = ?1")),
        keypoints(connection.Prepare("keypoints", "SELECT rows, cols, data FROM keypoints WHERE image_id = ?1")),
        matches(connection.Prepare("matches", "SELECT rows, cols, data FROM matches WHERE pair_id = ?1")),
        match_counts(connection, "matches"),
        inlier_counts(connection, "two_view_geometries") {}

  SqliteRows FindPair(const SqliteStatement& statement, uint32_t image_id1, uint32_t image_id2) const {
    return statement.Run({PairId(image_id1, image_id2)}, [=] {
      return "pair of " + ImageLabel(connection, image_id1) + " and " + ImageLabel(connection, image_id2);
    });
  }

  Points ReadKeypoints(uint32_t image_id) const {
    SqliteRows rows = keypoints.Run({image_id}, [=] { return ImageLabel(connection, image_id); });
    Points points;
    while (rows.Next()) {
      points.clear();
      for (const Keypoint& keypoint : ReadStoredKeypoints(rows)) points.emplace_back(keypoint.x, keypoint.y);
    }
    return points;
  }

  std::vector<PairSize> ReadPairSizes(const PairSizeStatements& statements, uint32_t image_id,
                                      const std::vector<uint32_t>& other_ids) const {
    std::vector<PairSize> sizes;
    const auto add_wanted = [&](SqliteRows rows) {
      while (rows.Next()) {
        const auto other_id = static_cast<uint32_t>(rows.Integer(0, 0, kMaxNumImages - 1));
        if (!std::binary_search(other_ids.begin(), other_ids.end(), other_id)) continue;
        sizes.push_back({other_id, static_cast<int>(rows.IntegerOrNothing(1, 1, kMaxInt).value_or(1))});
      }
    };
    const auto label = [=] { return "the pairs of " + ImageLabel(connection, image_id); };
    const auto smaller_end = std::lower_bound(other_ids.begin(), other_ids.end(), image_id);
    if (smaller_end != other_ids.begin()) {
      add_wanted(
          statements.with_image_second.Run({image_id, kMaxNumImages}, label, AsJson(other_ids.begin(), smaller_end)));
    }
    if (smaller_end != other_ids.end()) add_wanted(statements.with_image_first.Run({image_id, kMaxNumImages}, label));
    std::sort(sizes.begin(), sizes.end(), [](const PairSize& a, const PairSize& b) { return a.image_id < b.image_id; });
    return sizes;
  }

  SqliteConnection connection;
  SqliteStatement two_view_geometry, images, camera, keypoints, matches;
  PairSizeStatements match_counts, inlier_counts;
  LruCache<Points> keypoint_cache{[](const Points& points) { return sizeof(Eigen::Vector2f) * points.size(); }};
};

DatabaseReader::DatabaseReader(const std::filesystem::path& path) : impl_(std::make_unique<Impl>(path)) {}
DatabaseReader::~DatabaseReader() = default;

const std::filesystem::path& DatabaseReader::Path() const { return impl_->connection.File().Path(); }

std::vector<DatabaseImage> DatabaseReader::ReadImages(std::vector<DamagedImage>* damaged) const {
  std::vector<ImageRow> image_rows;
  int64_t image_id = 0;
  SqliteRows rows = impl_->images.Run({}, [&] { return "image " + std::to_string(image_id); });
  while (rows.Next()) image_rows.push_back(ReadImageRow(rows, &image_id));
  std::sort(image_rows.begin(), image_rows.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  std::vector<DatabaseImage> images;
  for (size_t i = 0; i < image_rows.size(); ++i) {
    ImageRow& row = image_rows[i];
    const bool has_twin = (i > 0 && image_rows[i - 1].name == row.name) ||
                          (i + 1 < image_rows.size() && image_rows[i + 1].name == row.name);
    if (row.damage.empty() && has_twin)
      row.damage = AsOneLine("table images: several images have the name " + row.name);
    if (row.damage.empty()) {
      images.push_back(row);
    } else if (damaged != nullptr) {
      damaged->push_back({row.name, row.damage});
    }
  }
  return images;
}

std::vector<DatabaseRigImage> DatabaseReader::ReadRigImages(std::vector<std::string>* damages) const {
  for (const char* table : {"rigs", "rig_sensors", "frames", "frame_data"}) {
    if (impl_->connection.ColumnNames(table).empty()) return {};
  }
  // Selects sensors of type 0, which are cameras.
  const SqliteStatement statement = impl_->connection.Prepare(
      "frame_data",
      "SELECT d.data_id, d.frame_id, r.ref_sensor_type = 0 AND r.ref_sensor_id = d.sensor_id, s.sensor_from_rig"
      " FROM frame_data d JOIN frames f ON f.frame_id = d.frame_id JOIN rigs r ON r.rig_id = f.rig_id"
      " LEFT JOIN rig_sensors s ON s.rig_id = r.rig_id AND s.sensor_id = d.sensor_id AND s.sensor_type = 0"
      " WHERE d.sensor_type = 0 ORDER BY d.frame_id, d.data_id");
  std::vector<DatabaseRigImage> images;
  uint32_t image_id = 0;
  SqliteRows rows = statement.Run({}, [&] { return ImageLabel(impl_->connection, image_id); });
  while (rows.Next()) {
    try {
      image_id = 0;
      image_id = static_cast<uint32_t>(rows.Integer(0, 0, kMaxNumImages - 1));
      const auto frame_id = static_cast<uint32_t>(rows.Integer(1, 0, kMaxCameraId));
      const bool is_reference = rows.Integer(2, 0, 1) == 1;
      images.push_back({image_id, frame_id, is_reference ? Rigid3d() : ReadSensorFromRig(rows, 3)});
    } catch (const DamagedRecordError& error) {
      damages->push_back(error.Damage());
    }
  }
  return images;
}

Camera DatabaseReader::ReadCamera(uint32_t camera_id) const {
  SqliteRows rows = impl_->camera.Run({camera_id}, [=] { return "camera " + std::to_string(camera_id); });
  std::optional<Camera> camera;
  while (rows.Next()) {
    camera.emplace();
    camera->camera_id = camera_id;
    camera->model_id = static_cast<int>(rows.Integer(0, std::numeric_limits<int>::min(), kMaxInt));
    camera->width = static_cast<uint64_t>(rows.Integer(1, 0, kMaxInt64));
    camera->height = static_cast<uint64_t>(rows.Integer(2, 0, kMaxInt64));
    camera->has_prior_focal_length = rows.Integer(3, 0, kMaxInt64) != 0;
    camera->params = ReadCameraParams(rows, rows.Blob(4));
    for (const double param : camera->params) {
      if (!std::isfinite(param)) rows.Fail("a camera parameter is not a finite number");
    }
  }
  if (!camera) rows.Fail("does not exist");
  return *camera;
}

std::vector<Eigen::Vector2d> DatabaseReader::ReadKeypoints(uint32_t image_id) const {
  return InDouble(*impl_->keypoint_cache.Get(image_id, [&] { return impl_->ReadKeypoints(image_id); }));
}

std::vector<Eigen::Vector2d> DatabaseReader::ReadKeypointsOnce(uint32_t image_id) const {
  return InDouble(impl_->ReadKeypoints(image_id));
}

std::vector<PairSize> DatabaseReader::ReadInlierCounts(uint32_t image_id,
                                                       const std::vector<uint32_t>& other_ids) const {
  return impl_->ReadPairSizes(impl_->inlier_counts, image_id, other_ids);
}

std::vector<PairSize> DatabaseReader::ReadMatchCounts(uint32_t image_id, const std::vector<uint32_t>& other_ids) const {
  return impl_->ReadPairSizes(impl_->match_counts, image_id, other_ids);
}

Matches DatabaseReader::ReadMatches(uint32_t query_id, uint32_t other_id) const {
  SqliteRows rows = impl_->FindPair(impl_->matches, query_id, other_id);
  Matches matches;
  while (rows.Next()) matches = ReadStoredMatches(rows);
  if (query_id < other_id) {
    for (Match& match : matches) std::swap(match.query_point, match.other_point);
  }
  std::sort(matches.begin(), matches.end());
  return matches;
}

std::optional<TwoViewGeometry> DatabaseReader::ReadTwoViewGeometry(uint32_t query_id, uint32_t other_id) const {
  SqliteRows rows = impl_->FindPair(impl_->two_view_geometry, query_id, other_id);
  std::optional<TwoViewGeometry> geometry;
  while (rows.Next()) {
    geometry.emplace();  // as stored, from the smaller id to the larger
    geometry->inlier_matches = ReadStoredMatches(rows);
    geometry->config = static_cast<TwoViewConfig>(rows.Integer(3, 0, static_cast<int>(TwoViewConfig::CALIBRATED_RIG)));
    geometry->E = ReadMatrix(rows, 4);
    geometry->F = ReadMatrix(rows, 5);
    geometry->H = ReadMatrix(rows, 6);
    geometry->query_from_other = ReadPose(rows, 7, 8);
    geometry->other_camera = ReadSerializedCamera(rows, 9);
    geometry->query_camera = ReadSerializedCamera(rows, 10);
  }
  if (!geometry) return std::nullopt;
  if (query_id < other_id) geometry = Inverted(*geometry);
  std::sort(geometry->inlier_matches.begin(), geometry->inlier_matches.end());
  if (geometry->query_from_other) geometry->query_from_other = CanonicalRelativePose(*geometry->query_from_other);
  return geometry;
}

}  // namespace lazyloc
