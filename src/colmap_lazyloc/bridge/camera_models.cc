#include "colmap_lazyloc/bridge/camera_models.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "colmap_lazyloc/bridge/convert.h"
#include "colmap_lazyloc/scene/equirectangular.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

// Models that COLMAP 4 added, in the order of their ids from kFirstModelOfColmap4. Listed here because error messages
// name them even if the linked COLMAP does not know them.
constexpr int kFirstModelOfColmap4 = 11;
const std::array<std::string, 7> kModelsOfColmap4 = {
    "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", kEquirectangular};

// Default of COLMAP's --ImageReader.default_focal_length_factor.
constexpr double kDefaultFocalLengthFactor = 1.2;

constexpr double kMaxFocalLengthRatio = 1e6;  // of focal length and image size, and of their inverses

// Indices of the parameters of tangential and thin prism distortion, which has a direction in the image.
const std::map<std::string, std::vector<size_t>> kDirectedParams = {
    {"OPENCV", {6, 7}},
    {"FULL_OPENCV", {6, 7}},
    {"THIN_PRISM_FISHEYE", {6, 7, 10, 11}},
    {"RAD_TAN_THIN_PRISM_FISHEYE", {10, 11, 12, 13, 14, 15}},
};

// Index of the first of the two coefficients of radial distortion.
const std::map<std::string, size_t> kRadialParams = {
    {"RADIAL", 3},         {"OPENCV", 4},         {"FULL_OPENCV", 4},
    {"RADIAL_FISHEYE", 3}, {"OPENCV_FISHEYE", 4}, {"THIN_PRISM_FISHEYE", 4},
};

bool IsColmaps(int model_id) { return colmap::ExistsCameraModelWithId(static_cast<colmap::CameraModelId>(model_id)); }

// Returns the indices of the parameters that are focal lengths.
std::vector<size_t> FocalLengthIdxs(const Camera& camera) {
  if (IsEquirectangular(camera)) return {};
  const colmap::Camera converted = ToColmap(camera);
  const auto idxs = converted.FocalLengthIdxs();
  return {idxs.begin(), idxs.end()};
}

}  // namespace

std::optional<int> CameraModelId(const std::string& model_name) {
  if (colmap::ExistsCameraModelWithName(model_name)) return static_cast<int>(colmap::CameraModelNameToId(model_name));
  const auto name = std::find(kModelsOfColmap4.begin(), kModelsOfColmap4.end(), model_name);
  if (name == kModelsOfColmap4.end()) return std::nullopt;
  return kFirstModelOfColmap4 + static_cast<int>(name - kModelsOfColmap4.begin());
}

std::string CameraModelName(int model_id) {
  if (IsColmaps(model_id)) return colmap::CameraModelIdToName(static_cast<colmap::CameraModelId>(model_id));
  const size_t idx = model_id - kFirstModelOfColmap4;
  return model_id >= kFirstModelOfColmap4 && idx < kModelsOfColmap4.size() ? kModelsOfColmap4[idx] : "";
}

size_t CameraModelNumParams(int model_id) {
  if (model_id == kEquirectangularId) return 2;
  return IsColmaps(model_id) ? colmap::CameraModelNumParams(static_cast<colmap::CameraModelId>(model_id)) : 0;
}

std::string CameraProblem(const Camera& camera) {
  const std::string name = CameraModelName(camera.model_id);
  if (name.empty()) return "unknown camera model " + std::to_string(camera.model_id);
  const size_t num_params = CameraModelNumParams(camera.model_id);
  if (num_params == 0) {
    return "the COLMAP that this program was built against does not know camera model " + name +
           ": build against a newer COLMAP 4 (docs/installation.md)";
  }
  if (camera.params.size() != num_params) {
    return "camera model " + name + " takes " + std::to_string(num_params) + " parameters, not " +
           std::to_string(camera.params.size());
  }
  for (const double param : camera.params) {
    if (!std::isfinite(param)) return "a camera parameter is not a finite number";
  }
  if (camera.width == 0 || camera.height == 0) return "the camera's image size is zero";
  if (IsEquirectangular(camera) && !(camera.params[0] > 0 && camera.params[1] > 0)) {
    return "a parameter of the camera, its width or height, is not positive";
  }
  const double size = static_cast<double>(std::max(camera.width, camera.height));
  for (const size_t idx : FocalLengthIdxs(camera)) {
    const double focal_length = camera.params[idx];
    if (focal_length <= 0) return "the camera's focal length is not positive";
    // Refuses what no lens has, because squares of it overflow in COLMAP's estimators.
    if (focal_length < size / kMaxFocalLengthRatio || focal_length > size * kMaxFocalLengthRatio) {
      return Format("the camera's focal length of %g pixels is impossible for an image of %g pixels", focal_length,
                    size);
    }
  }
  return "";
}

Camera CameraFromFocalLength(int model_id, double focal_length_px, uint64_t width, uint64_t height) {
  const colmap::Camera made = colmap::Camera::CreateFromModelId(
      /*camera_id=*/0, static_cast<colmap::CameraModelId>(model_id), focal_length_px, width, height);
  return {0, model_id, width, height, made.params, /*has_prior_focal_length=*/true};
}

double GuessFocalLengthPx(uint64_t width, uint64_t height) {
  return kDefaultFocalLengthFactor * static_cast<double>(std::max(width, height));
}

double MeanFocalLength(const Camera& camera) {
  return IsEquirectangular(camera) ? EquirectangularPxPerRad(camera) : MeanFocalLengthPx(camera).value_or(0);
}

Eigen::Vector2d PrincipalPoint(const Camera& camera) {
  const Eigen::Vector2d centre(0.5 * static_cast<double>(camera.width), 0.5 * static_cast<double>(camera.height));
  if (IsEquirectangular(camera)) return centre;
  const colmap::Camera converted = ToColmap(camera);
  if (converted.PrincipalPointIdxs().size() != 2) return centre;
  return {converted.PrincipalPointX(), converted.PrincipalPointY()};
}

IntrinsicsOrigin OriginOfStoredCamera(const Camera& camera) {
  const auto is_made_with = [&](double focal_length_px) {
    return SameIntrinsics(camera, CameraFromFocalLength(camera.model_id, focal_length_px, camera.width, camera.height));
  };
  const std::vector<size_t> focal_idxs = FocalLengthIdxs(camera);
  if (focal_idxs.empty()) return IntrinsicsOrigin::GIVEN;
  if (camera.has_prior_focal_length) {
    return is_made_with(camera.params[focal_idxs.front()]) ? IntrinsicsOrigin::EXIF : IntrinsicsOrigin::GIVEN;
  }
  return is_made_with(GuessFocalLengthPx(camera.width, camera.height)) ? IntrinsicsOrigin::GUESS
                                                                       : IntrinsicsOrigin::GIVEN;
}

Camera WithFocalFactor(const Camera& camera, double factor) {
  Camera scaled = camera;
  for (const size_t idx : FocalLengthIdxs(camera)) scaled.params[idx] *= factor;
  return scaled;
}

Camera WithShiftedPrincipalPoint(const Camera& camera, const Eigen::Vector2d& shift_px) {
  Camera shifted = camera;
  if (IsEquirectangular(camera)) return shifted;
  const colmap::Camera converted = ToColmap(camera);
  const auto centre = converted.PrincipalPointIdxs();
  for (size_t axis = 0; axis < centre.size(); ++axis) shifted.params[centre[axis]] += shift_px[axis];
  return shifted;
}

std::optional<Eigen::Vector2d> RadialDistortion(const Camera& camera) {
  const auto params = kRadialParams.find(CameraModelName(camera.model_id));
  if (params == kRadialParams.end()) return std::nullopt;
  return Eigen::Vector2d(camera.params[params->second], camera.params[params->second + 1]);
}

Camera WithRadialDistortion(const Camera& camera, const Eigen::Vector2d& coefficients) {
  Camera distorted = camera;
  const size_t first = kRadialParams.at(CameraModelName(camera.model_id));
  distorted.params[first] = coefficients[0];
  distorted.params[first + 1] = coefficients[1];
  return distorted;
}

Camera AsOpenCv(const Camera& camera) {
  const std::string name = CameraModelName(camera.model_id);
  if (name != "SIMPLE_RADIAL" && name != "RADIAL") return camera;
  const std::vector<double>& p = camera.params;  // f, cx, cy, k1 and, with RADIAL, k2
  Camera converted = camera;
  converted.model_id = *CameraModelId("OPENCV");
  converted.params = {p[0], p[0], p[1], p[2], p[3], name == "RADIAL" ? p[4] : 0, 0, 0};
  return converted;
}

double LogAspectRatio(const Camera& camera) {
  const std::vector<size_t> idxs = FocalLengthIdxs(camera);
  return idxs.size() == 2 ? std::log(camera.params[idxs[1]] / camera.params[idxs[0]]) : 0;
}

Camera WithAspectFactor(const Camera& camera, double factor) {
  Camera stretched = camera;
  const std::vector<size_t> idxs = FocalLengthIdxs(camera);
  if (idxs.size() != 2) return stretched;
  stretched.params[idxs[0]] /= std::sqrt(factor);
  stretched.params[idxs[1]] *= std::sqrt(factor);
  return stretched;
}

std::optional<double> MeanFocalLengthPx(const Camera& camera) {
  const std::vector<size_t> idxs = FocalLengthIdxs(camera);
  if (idxs.empty()) return std::nullopt;
  double sum = 0;
  for (const size_t idx : idxs) sum += camera.params[idx];
  return sum / static_cast<double>(idxs.size());
}

Camera Transposed(const Camera& camera) {
  Camera turned = camera;
  std::swap(turned.width, turned.height);
  if (IsEquirectangular(camera)) return turned;
  const colmap::Camera converted = ToColmap(camera);
  const auto focal = converted.FocalLengthIdxs();
  if (focal.size() == 2) std::swap(turned.params[focal[0]], turned.params[focal[1]]);
  const auto centre = converted.PrincipalPointIdxs();
  if (centre.size() == 2) {
    turned.params[centre[0]] = static_cast<double>(turned.width) / 2;
    turned.params[centre[1]] = static_cast<double>(turned.height) / 2;
  }
  const auto directed = kDirectedParams.find(CameraModelName(camera.model_id));
  if (directed == kDirectedParams.end()) return turned;
  for (const size_t i : directed->second) turned.params[i] = 0;
  return turned;
}

}  // namespace lazyloc
