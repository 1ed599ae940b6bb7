#include "colmap_lazyloc/queries/photo_camera.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

// Maximum ratio of a camera's focal length to that of EXIF. EXIF is often off by some per cent, because it rounds or
// does not know the crop; another lens or zoom differs by more.
constexpr double kMaxExifRatio = 1.25;
// Maximum ratio of focal lengths that agree: those of one lens in cameras that were calibrated separately.
constexpr double kMaxAgreeingRatio = 1.05;
// Maximum ratio of focal lengths in EXIF that are the same, which are rounded.
constexpr double kMaxSameExifRatio = 1.005;

constexpr size_t kMaxNumCameras = 1000;  // of one size

bool Agree(double a, double b, double max_ratio) { return std::abs(std::log(a / b)) <= std::log(max_ratio); }

bool ContradictsExif(const PhotoProperties& photo, const DatabaseCamera& camera, double focal_length_px) {
  if (!photo.exif_camera.empty() && !camera.exif_camera.empty() && photo.exif_camera != camera.exif_camera) return true;
  return photo.exif_focal_length_px && !Agree(focal_length_px, *photo.exif_focal_length_px, kMaxExifRatio);
}

// Returns the cameras whose images have the focal length of the photo's EXIF.
std::vector<DatabaseCamera> OfSameDevice(const PhotoProperties& photo, const std::vector<DatabaseCamera>& cameras) {
  std::vector<DatabaseCamera> same;
  std::copy_if(cameras.begin(), cameras.end(), std::back_inserter(same), [&](const DatabaseCamera& camera) {
    return photo.exif_focal_length_px && camera.exif_focal_length_px &&
           Agree(*photo.exif_focal_length_px, *camera.exif_focal_length_px, kMaxSameExifRatio);
  });
  return same;
}

struct Candidate {
  const DatabaseCamera* camera = nullptr;
  double focal_length_px = 0;
};

// Returns the cameras of exactly the photo's size, or (is_turned) of the size with its sides exchanged.
std::vector<Candidate> FindCandidates(const PhotoProperties& photo, const std::vector<DatabaseCamera>& cameras,
                                      bool is_turned) {
  std::vector<Candidate> candidates;
  const auto width = is_turned ? photo.height : photo.width, height = is_turned ? photo.width : photo.height;
  for (const DatabaseCamera& camera : cameras) {
    if (camera.camera.width != width || camera.camera.height != height) continue;
    const std::optional<double> focal_length_px = MeanFocalLengthPx(camera.camera);
    if (!focal_length_px || ContradictsExif(photo, camera, *focal_length_px)) continue;
    candidates.push_back({&camera, *focal_length_px});
  }
  return candidates;
}

// Returns the camera of the image with the median focal length; nullopt if no more than half of the images agree on its
// focal length.
std::optional<DatabaseCamera> ChooseByMajority(std::vector<Candidate> candidates) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.focal_length_px < b.focal_length_px; });
  int num_images = 0;
  for (const Candidate& candidate : candidates) num_images += candidate.camera->num_images;
  int num_below = 0;
  for (const Candidate& median : candidates) {
    num_below += median.camera->num_images;
    if (2 * num_below < num_images) continue;
    int num_agreeing = 0;
    for (const Candidate& other : candidates) {
      if (Agree(other.focal_length_px, median.focal_length_px, kMaxAgreeingRatio)) {
        num_agreeing += other.camera->num_images;
      }
    }
    return 2 * num_agreeing > num_images ? std::make_optional(*median.camera) : std::nullopt;
  }
  return std::nullopt;
}

std::optional<DatabaseCamera> ChooseDatabaseCamera(const PhotoProperties& photo,
                                                   const std::vector<DatabaseCamera>& cameras) {
  const std::vector<Candidate> upright = FindCandidates(photo, cameras, /*is_turned=*/false);
  if (!upright.empty()) return ChooseByMajority(upright);
  std::optional<DatabaseCamera> turned = ChooseByMajority(FindCandidates(photo, cameras, /*is_turned=*/true));
  if (turned) turned->camera = Transposed(turned->camera);
  return turned;
}

// is_same_device: true if EXIF shows that the photo's camera is this one, with the same zoom. Each of its images may
// still have a camera of its own, as COLMAP makes them by default; none of these is the photo's.
IntrinsicsOrigin OriginOf(const DatabaseCamera& camera, bool is_same_device) {
  if (camera.num_images == 1) return IntrinsicsOrigin::SIMILAR;
  return is_same_device ? IntrinsicsOrigin::MODEL : IntrinsicsOrigin::SHARED;
}

// Returns a camera of the database if there is one, else `own`, which has the focal length of EXIF or a guessed one.
PhotoCamera ChooseBetween(const PhotoCamera& own, const PhotoProperties& photo,
                          const std::vector<DatabaseCamera>& database_cameras) {
  // Keeps the photo's id, because that of the model is another camera's.
  const auto choose = [&own](const PhotoProperties& properties, const std::vector<DatabaseCamera>& cameras) {
    std::optional<DatabaseCamera> chosen = ChooseDatabaseCamera(properties, cameras);
    if (chosen) chosen->camera.camera_id = own.camera.camera_id;
    return chosen;
  };
  // Does not compare EXIF's focal length with the refined one of the same device, because EXIF may be far off.
  PhotoProperties without_focal_length = photo;
  without_focal_length.exif_focal_length_px.reset();
  if (const auto same = choose(without_focal_length, OfSameDevice(photo, database_cameras))) {
    return {same->camera, IntrinsicsSource::DATABASE_CAMERA, OriginOf(*same, /*is_same_device=*/true)};
  }
  if (const auto other = choose(photo, database_cameras)) {
    return {other->camera, IntrinsicsSource::DATABASE_CAMERA, OriginOf(*other, /*is_same_device=*/false)};
  }
  return own;
}

}  // namespace

CamerasBySize::CamerasBySize(const Model& model, const std::map<uint32_t, double>& exif_focal_lengths_px) {
  std::map<uint32_t, int> num_images;
  for (const ModelImage& image : model.images) ++num_images[image.camera_id];
  for (const auto& [camera_id, count] : num_images) {
    const Camera& camera = model.cameras.at(camera_id);
    const auto exif = exif_focal_lengths_px.find(camera_id);
    cameras_[std::minmax({camera.width, camera.height})].push_back(
        {camera, count, "", exif == exif_focal_lengths_px.end() ? std::nullopt : std::make_optional(exif->second)});
  }
  for (auto& [size, cameras] : cameras_) {
    std::stable_sort(cameras.begin(), cameras.end(),
                     [](const DatabaseCamera& a, const DatabaseCamera& b) { return a.num_images > b.num_images; });
    if (cameras.size() > kMaxNumCameras) cameras.resize(kMaxNumCameras);
  }
}

std::vector<DatabaseCamera> CamerasBySize::OfSize(uint64_t width, uint64_t height) const {
  const auto found = cameras_.find(std::minmax({width, height}));
  return found == cameras_.end() ? std::vector<DatabaseCamera>() : found->second;
}

std::optional<double> FocalLengthOfExifPx(const Camera& stored) {
  return OriginOfStoredCamera(stored) == IntrinsicsOrigin::EXIF ? MeanFocalLengthPx(stored) : std::nullopt;
}

PhotoProperties PropertiesOfStored(const Camera& stored) {
  PhotoProperties properties;
  properties.width = stored.width;
  properties.height = stored.height;
  properties.exif_focal_length_px = FocalLengthOfExifPx(stored);
  return properties;
}

IntrinsicsOrigin PhotoCamera::Origin() const {
  switch (source) {
    case IntrinsicsSource::MODEL: return IntrinsicsOrigin::MODEL;
    case IntrinsicsSource::DATABASE: return OriginOfStoredCamera(camera);
    case IntrinsicsSource::DATABASE_CAMERA: return database_origin;
    case IntrinsicsSource::EXIF: return IntrinsicsOrigin::EXIF;
    case IntrinsicsSource::GUESS: return IntrinsicsOrigin::GUESS;
    case IntrinsicsSource::JOINT: return IntrinsicsOrigin::JOINT;
    default: return IntrinsicsOrigin::GIVEN;
  }
}

PhotoCamera ChoosePhotoCamera(const PhotoProperties& photo, const DefaultCamera& default_camera,
                              const std::vector<DatabaseCamera>& database_cameras) {
  if (!default_camera.params.empty()) {
    return {{0, default_camera.model_id, photo.width, photo.height, default_camera.params, true},
            IntrinsicsSource::CAMERA_PARAMS};
  }
  const double guess_px = GuessFocalLengthPx(photo.width, photo.height);
  PhotoCamera own;
  own.source = photo.exif_focal_length_px ? IntrinsicsSource::EXIF : IntrinsicsSource::GUESS;
  own.camera = CameraFromFocalLength(default_camera.model_id, photo.exif_focal_length_px.value_or(guess_px),
                                     photo.width, photo.height);
  own.camera.has_prior_focal_length = photo.exif_focal_length_px.has_value();
  return ChooseBetween(own, photo, database_cameras);
}

PhotoCamera ChooseStoredCamera(const Camera& stored, const std::vector<DatabaseCamera>& database_cameras) {
  const IntrinsicsOrigin origin = OriginOfStoredCamera(stored);
  PhotoCamera own{stored, IntrinsicsSource::DATABASE};
  if (origin != IntrinsicsOrigin::EXIF && origin != IntrinsicsOrigin::GUESS) return own;
  return ChooseBetween(own, PropertiesOfStored(stored), database_cameras);
}

}  // namespace lazyloc
