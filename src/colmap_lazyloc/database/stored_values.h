#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "colmap_lazyloc/database/sqlite.h"
#include "colmap_lazyloc/math/rigid3.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

// What COLMAP's columns hold, 3.6 to 4.2. A value that has not the form of its column fails by SqliteRows::Fail.

std::vector<double> ReadCameraParams(const SqliteRows& row, int column);

// Of tables in the columns rows, cols, data (0 to 2 of the statement): pixels, and matches of (image_id1, image_id2) as
// if image_id2 were the query.
std::vector<Eigen::Vector2f> ReadStoredKeypoints(const SqliteRows& row);
Matches ReadStoredMatches(const SqliteRows& row);

// The following may be unset.

// The identity is what COLMAP's database.py, and with it hloc, stores for want of a matrix. (No E or F is one.)
std::optional<Eigen::Matrix3d> ReadMatrix(const SqliteRows& row, int column);

// For 3.x, no rotation and no translation at once mean unset; a rotation alone is the pose of a panoramic pair.
std::optional<Rigid3d> ReadPose(const SqliteRows& row, int qvec_column, int tvec_column);

std::optional<Rigid3d> ReadSensorFromRig(const SqliteRows& row, int column);

// 4.x: camera_id u32, model i32, width u64, height u64, prior u8, number of parameters u64, parameters f64, unpadded.
std::optional<Camera> ReadSerializedCamera(const SqliteRows& row, int column);

}  // namespace lazyloc
