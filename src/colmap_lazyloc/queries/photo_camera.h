#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/intrinsics_source.h"
#include "colmap_lazyloc/scene/model.h"

namespace lazyloc {

// Intrinsics of a photo and where they were found.
struct PhotoCamera {
  Camera camera;
  IntrinsicsSource source = IntrinsicsSource::GUESS;
  IntrinsicsOrigin database_origin = IntrinsicsOrigin::SHARED;  // if a camera of the database was chosen

  // Returns how far the images may correct the intrinsics.
  IntrinsicsOrigin Origin() const;
};

// A camera of posed images.
struct DatabaseCamera {
  Camera camera;
  int num_images = 0;
  std::string exif_camera;  // make and model; empty if unknown
  // Focal length in the EXIF of its images, before the reconstruction refined it.
  std::optional<double> exif_focal_length_px = std::nullopt;
};

// The cameras of posed images by their size, of which one may have taken a query. Makes and models are not known.
class CamerasBySize {
 public:
  // exif_focal_lengths_px: those that are known, by camera id.
  CamerasBySize(const Model& model, const std::map<uint32_t, double>& exif_focal_lengths_px);

  // Returns the cameras that have this size, or that with its sides exchanged, most used ones first. There
  // are at most 1,000, because a database may have a camera for each image.
  std::vector<DatabaseCamera> OfSize(uint64_t width, uint64_t height) const;

 private:
  using Size = std::pair<uint64_t, uint64_t>;  // shorter side first
  std::map<Size, std::vector<DatabaseCamera>> cameras_;
};

// Camera model and parameters for all photos without a camera of their own.
struct DefaultCamera {
  int model_id = 0;
  std::vector<double> params;  // empty if they are not given
};

// Returns the focal length in pixels that COLMAP found in the EXIF of images with a stored camera; nullopt if there was
// none. A model has refined ones, but the database file keeps what its reconstruction started from.
std::optional<double> FocalLengthOfExifPx(const Camera& stored);

// Returns the size of an image with a stored camera, and what the camera shows about the image's EXIF.
PhotoProperties PropertiesOfStored(const Camera& stored);

// Chooses the intrinsics of a photo without a camera of its own, from the first of these:
// 1. the parameters of the default camera;
// 2. a camera of the database with the photo's size (else, with its sides exchanged). It must not contradict the make,
//    model and focal length of EXIF, and more than half of the images with such cameras must agree on its focal length.
//    Those whose own EXIF has the photo's focal length are the same device and come first;
// 3. the focal length in EXIF;
// 4. COLMAP's guess of the focal length, 1.2 times the longer side.
PhotoCamera ChoosePhotoCamera(const PhotoProperties& photo, const DefaultCamera& default_camera,
                              const std::vector<DatabaseCamera>& database_cameras);

// Chooses in the same way for an image with keypoints, whose camera COLMAP made from EXIF's or a guessed focal length.
// Other cameras stay.
PhotoCamera ChooseStoredCamera(const Camera& stored, const std::vector<DatabaseCamera>& database_cameras);

}  // namespace lazyloc
