#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/database/sqlite.h"
#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// Functions that decode the values of COLMAP's columns, 3.6 to 4.2. They call SqliteRows::Fail if a value does not have
// the form of its column.

// Returns `image <id> (<name>)` for messages; without the name if that is unknown or damaged.
std::string ImageLabel(const SqliteConnection& connection, uint32_t image_id);

// blob: a column of the row, or a part of one.
std::vector<double> ReadCameraParams(const SqliteRows& row, const ByteSpan& blob);

// Decode a table of numbers in the statement's columns 0 to 2 (rows, cols, data). Keypoints have two columns (x, y),
// four (with scale and orientation) or six (with an affine shape). Matches are stored as (image_id1, image_id2) and
// returned as if image_id2 were the query.
std::vector<Keypoint> ReadStoredKeypoints(const SqliteRows& row);
Matches ReadStoredMatches(const SqliteRows& row);

// The functions below return nullopt if the value is unset.

// The identity counts as unset, because COLMAP's database.py, and with it hloc, stores it instead of a missing matrix.
// (No E or F is the identity.)
std::optional<Eigen::Matrix3d> ReadMatrix(const SqliteRows& row, int column);

// COLMAP 3.x stores an unset pose as no rotation and no translation; a rotation alone is the pose of a panoramic pair.
std::optional<Rigid3d> ReadPose(const SqliteRows& row, int qvec_column, int tvec_column);

std::optional<Rigid3d> ReadSensorFromRig(const SqliteRows& row, int column);

// Decodes a camera of COLMAP 4.x: camera_id u32, model i32, width u64, height u64, prior u8, number of parameters u64,
// parameters f64, unpadded.
std::optional<Camera> ReadSerializedCamera(const SqliteRows& row, int column);

}  // namespace lazyloc
