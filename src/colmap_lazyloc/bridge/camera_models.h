#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// The camera models of COLMAP up to 4.2. CameraProblem tells those that the linked COLMAP does not know.
std::optional<int> CameraModelId(const std::string& model_name);
// Empty for an unknown model.
std::string CameraModelName(int model_id);
// Zero where the linked COLMAP does not know the model.
size_t CameraModelNumParams(int model_id);
// Why the camera cannot be used (a model that the linked COLMAP does not know, wrong number of parameters, non-finite
// or non-positive focal length, zero size); empty when it can.
std::string CameraProblem(const Camera& camera);

// The camera of that model with the principal point in the middle and no distortion.
Camera CameraFromFocalLength(int model_id, double focal_length_px, uint64_t width, uint64_t height);
// The camera with all its model's focal lengths multiplied.
Camera WithFocalFactor(const Camera& camera, double factor);

// Viewing direction of an image point (pixels), unit length, in the camera's frame; none where the model
// has no inverse there.
std::optional<Eigen::Vector3d> RayInCam(const Camera& camera, const Eigen::Vector2d& xy);
// The same for many image points of one camera, which is converted to COLMAP's only once.
using RayInCamFunction = std::function<std::optional<Eigen::Vector3d>(const Eigen::Vector2d& xy)>;
RayInCamFunction RaysInCam(const Camera& camera);

// Image point (pixels) of a point in the camera's frame; none behind the camera.
std::optional<Eigen::Vector2d> ImageFromCam(const Camera& camera, const Eigen::Vector3d& point_in_cam);

}  // namespace lazyloc
