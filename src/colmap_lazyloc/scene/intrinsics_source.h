#pragma once

#include <array>

#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/enum_names.h"

namespace lazyloc {

// Source in which the intrinsics of a query were found.
enum class IntrinsicsSource {
  QUERY_LIST,
  MODEL,            // an image of this name in the input model
  DATABASE,         // an image of this name in the database
  CAMERA_PARAMS,    // the option for all photos
  DATABASE_CAMERA,  // a camera of posed images that have the photo's size
  EXIF,             // the focal length in the photo's EXIF
  GUESS,            // COLMAP's guess of the focal length, from the photo's size
  JOINT,            // estimated from several queries of this camera
};
template <>
inline constexpr std::array<const char*, 8> kEnumNames<IntrinsicsSource> = {
    "query_list", "model", "database", "camera_params", "database_camera", "exif", "guess", "joint"};

}  // namespace lazyloc
