#include "colmap_lazyloc/testing/test_database.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <Eigen/LU>
#include <sqlite3.h>

namespace lazyloc {
namespace {

constexpr char kTables[] = R"(
CREATE TABLE cameras (
  camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL, width INTEGER NOT NULL,
  height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE keypoints (
  image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
)";

constexpr char kImages[] = R"(
CREATE TABLE images (
  image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL, )";
constexpr char kImagesPrior[] = R"(
  prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL, prior_tx REAL, prior_ty REAL, prior_tz REAL, )";
constexpr char kImagesEnd[] = R"(
  CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
)";

constexpr char kTwoViewGeometries[] = R"(
CREATE TABLE two_view_geometries (
  pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB)";

template <typename T>
void Append(const T& value, std::vector<unsigned char>* blob) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(&value);
  blob->insert(blob->end(), bytes, bytes + sizeof(T));
}

std::vector<unsigned char> DoublesBlob(const double* values, size_t num_values) {
  std::vector<unsigned char> blob;
  for (size_t i = 0; i < num_values; ++i) Append(values[i], &blob);
  return blob;
}

std::vector<unsigned char> CameraBlob(const std::optional<Camera>& camera) {
  std::vector<unsigned char> blob;
  if (!camera) return blob;
  Append(camera->camera_id, &blob);
  Append<int32_t>(camera->model_id, &blob);
  Append(camera->width, &blob);
  Append(camera->height, &blob);
  Append<uint8_t>(camera->has_prior_focal_length, &blob);
  Append<uint64_t>(camera->params.size(), &blob);
  for (const double param : camera->params) Append(param, &blob);
  return blob;
}

// Serialises matches; the image with the smaller id comes first.
std::vector<unsigned char> MatchesBlob(const Matches& matches, bool database_is_first) {
  std::vector<unsigned char> blob;
  for (const Match& match : matches) {
    Append(database_is_first ? match.other_point : match.query_point, &blob);
    Append(database_is_first ? match.query_point : match.other_point, &blob);
  }
  return blob;
}

int64_t PairId(uint32_t id1, uint32_t id2) { return std::min(id1, id2) * int64_t{2147483647} + std::max(id1, id2); }

}  // namespace

TestDatabase::TestDatabase(const std::filesystem::path& path, Schema schema) : schema_(schema) {
  if (std::filesystem::exists(path)) throw std::runtime_error(path.string() + " exists");
  if (sqlite3_open(path.u8string().c_str(), &connection_) != SQLITE_OK) {
    const std::string message = sqlite3_errmsg(connection_);
    Close();
    throw std::runtime_error(path.string() + ": " + message);
  }
  Execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=OFF;");
  const bool has_prior = schema == Schema::V3_6 || schema == Schema::V3_8;
  std::string two_view_geometries = kTwoViewGeometries;
  if (schema != Schema::V3_6) two_view_geometries += ", qvec BLOB, tvec BLOB";
  if (schema == Schema::V4_2) two_view_geometries += ", camera1 BLOB, camera2 BLOB";
  Execute(kTables + std::string(kImages) + (has_prior ? kImagesPrior : "") + kImagesEnd + two_view_geometries + ");");
  Execute(
      "CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,"
      " cols INTEGER NOT NULL, data BLOB" +
      std::string(schema == Schema::V4_2 ? ", type INTEGER NOT NULL" : "") + ")");
  const char* version[] = {"3600", "3800", "3900", "4020000"};
  Execute(std::string("PRAGMA user_version=") + version[static_cast<int>(schema)]);
}

TestDatabase::~TestDatabase() { Close(); }

void TestDatabase::Close() {
  sqlite3_close(connection_);
  connection_ = nullptr;
}

void TestDatabase::Execute(const std::string& sql) {
  if (sqlite3_exec(connection_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) {
    throw std::runtime_error(sql + ": " + sqlite3_errmsg(connection_));
  }
}

void TestDatabase::Insert(const std::string& table, const std::vector<Value>& values) {
  std::string sql = "INSERT INTO " + table + " VALUES(?";
  for (size_t i = 1; i < values.size(); ++i) sql += ",?";
  sqlite3_stmt* statement = nullptr;
  sqlite3_prepare_v2(connection_, (sql + ")").c_str(), -1, &statement, nullptr);
  for (size_t i = 0; i < values.size(); ++i) {
    const int index = static_cast<int>(i) + 1;
    if (const auto* integer = std::get_if<int64_t>(&values[i])) {
      sqlite3_bind_int64(statement, index, *integer);
    } else if (const auto* text = std::get_if<std::string>(&values[i])) {
      sqlite3_bind_text(statement, index, text->data(), static_cast<int>(text->size()), SQLITE_STATIC);
    } else if (const auto& blob = std::get<Blob>(values[i]); !blob.empty()) {
      sqlite3_bind_blob(statement, index, blob.data(), static_cast<int>(blob.size()), SQLITE_STATIC);
    }
  }
  const int code = sqlite3_step(statement);
  sqlite3_finalize(statement);
  if (code != SQLITE_DONE) throw std::runtime_error(sql + ": " + sqlite3_errmsg(connection_));
}

void TestDatabase::AddCamera(const Camera& camera) {
  Insert("cameras", {int64_t{camera.camera_id}, int64_t{camera.model_id}, static_cast<int64_t>(camera.width),
                     static_cast<int64_t>(camera.height), DoublesBlob(camera.params.data(), camera.params.size()),
                     int64_t{camera.has_prior_focal_length}});
}

void TestDatabase::AddImage(uint32_t image_id, uint32_t camera_id, const std::string& name) {
  Insert("images(image_id, name, camera_id)", {int64_t{image_id}, name, int64_t{camera_id}});
}

void TestDatabase::AddKeypoints(uint32_t image_id, const std::vector<Eigen::Vector2d>& keypoints, int num_cols) {
  Blob blob;
  for (const Eigen::Vector2d& xy : keypoints) {
    Append(static_cast<float>(xy.x()), &blob);
    Append(static_cast<float>(xy.y()), &blob);
    for (int col = 2; col < num_cols; ++col) Append(static_cast<float>(col), &blob);
  }
  Insert("keypoints", {int64_t{image_id}, static_cast<int64_t>(keypoints.size()), int64_t{num_cols}, blob});
}

void TestDatabase::AddScaledKeypoints(uint32_t image_id, const std::vector<Keypoint>& keypoints) {
  Blob blob;
  for (const Keypoint& k : keypoints) {
    for (const float number : {k.x, k.y, k.a11, k.a12, k.a21, k.a22}) Append(number, &blob);
  }
  Insert("keypoints", {int64_t{image_id}, static_cast<int64_t>(keypoints.size()), int64_t{6}, blob});
}

void TestDatabase::AddDescriptors(uint32_t image_id, const Descriptors& descriptors, int type) {
  std::vector<Value> values = {int64_t{image_id}, int64_t{descriptors.rows()}, int64_t{descriptors.cols()},
                               Blob(descriptors.data(), descriptors.data() + descriptors.size())};
  if (schema_ == Schema::V4_2) values.emplace_back(int64_t{type});
  Insert("descriptors", values);
}

void TestDatabase::AddMatches(uint32_t query_id, uint32_t database_id, const Matches& matches) {
  Insert("matches", {PairId(query_id, database_id), static_cast<int64_t>(matches.size()), int64_t{2},
                     MatchesBlob(matches, database_id < query_id)});
}

TestDatabase::Blob TestDatabase::MatrixBlob(const std::optional<Eigen::Matrix3d>& matrix) const {
  if (!matrix && schema_ == Schema::V4_2) return {};
  const Eigen::Matrix3d row_major = matrix.value_or(Eigen::Matrix3d::Zero()).transpose();
  return DoublesBlob(row_major.data(), 9);
}

void TestDatabase::AddTwoViewGeometry(uint32_t query_id, uint32_t database_id, const TwoViewGeometry& geometry) {
  const bool is_3x = schema_ != Schema::V4_2;
  const bool database_is_first = database_id < query_id;
  TwoViewGeometry stored = geometry;
  if (is_3x && !stored.H) stored.H = Eigen::Matrix3d::Zero();
  if (!database_is_first) {
    if (stored.E) stored.E->transposeInPlace();
    if (stored.F) stored.F->transposeInPlace();
    if (stored.H) stored.H = stored.H->inverse().eval();  // NaN for the zero matrix of COLMAP 3
    if (Rigid3d* pose = stored.query_from_other ? &*stored.query_from_other : nullptr) {
      pose->rotation = pose->rotation.inverse();
      pose->translation = -(pose->rotation * pose->translation);
    }
    std::swap(stored.query_camera, stored.other_camera);
  }
  if (is_3x && !stored.query_from_other) {
    // Stores an unset pose like COLMAP 3.8 (zeros, or the identity if the images are swapped) or 3.10 (the identity).
    const double w = schema_ == Schema::V3_8 && database_is_first ? 0 : 1;
    stored.query_from_other = Rigid3d{{w, 0, 0, 0}, Eigen::Vector3d::Zero()};
  }
  Blob qvec, tvec;
  if (const auto& pose = stored.query_from_other) {
    const Eigen::Quaterniond& q = pose->rotation;
    qvec = DoublesBlob(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()).data(), 4);
    tvec = DoublesBlob(pose->translation.data(), 3);
  }
  std::vector<Value> values = {PairId(query_id, database_id),
                               static_cast<int64_t>(stored.inlier_matches.size()),
                               int64_t{2},
                               MatchesBlob(stored.inlier_matches, database_is_first),
                               static_cast<int64_t>(stored.config),
                               MatrixBlob(stored.F),
                               MatrixBlob(stored.E),
                               MatrixBlob(stored.H)};
  if (schema_ != Schema::V3_6) values.insert(values.end(), {qvec, tvec});
  if (schema_ == Schema::V4_2) {
    values.insert(values.end(), {CameraBlob(stored.other_camera), CameraBlob(stored.query_camera)});
  }
  Insert("two_view_geometries", values);
}

}  // namespace lazyloc
