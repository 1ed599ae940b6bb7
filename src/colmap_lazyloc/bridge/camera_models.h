#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "colmap_lazyloc/scene/camera.h"

namespace lazyloc {

// Returns the id of a camera model of COLMAP up to 4.2, nullopt for any other name. The linked COLMAP may not know the
// model: see CameraProblem.
std::optional<int> CameraModelId(const std::string& model_name);
// Returns the name of a camera model of COLMAP up to 4.2, an empty string for any other id.
std::string CameraModelName(int model_id);
// Returns the number of parameters, 0 if neither we nor the linked COLMAP know the model.
size_t CameraModelNumParams(int model_id);
// Returns why the camera cannot be used: a model that neither we nor COLMAP know, a wrong number of parameters, a
// parameter that is not finite, a focal length that is not positive, or an image of size zero. Empty if it can be used.
std::string CameraProblem(const Camera& camera);

// Returns a camera of the model with the principal point in the image centre and no distortion.
Camera CameraFromFocalLength(int model_id, double focal_length_px, uint64_t width, uint64_t height);
// Returns the mean of the model's focal lengths in pixels; the pixels per radian of a spherical model.
double MeanFocalLength(const Camera& camera);
// Returns the principal point; the image's centre for a model without one.
Eigen::Vector2d PrincipalPoint(const Camera& camera);
// Returns COLMAP's guess of an unknown focal length, 1.2 times the longer side.
double GuessFocalLengthPx(uint64_t width, uint64_t height);
// Returns the origin of the intrinsics that a database stores, judged by their look because databases do not tell it.
// COLMAP makes a camera with no distortion and the principal point at the centre. Its focal length is EXIF's, which
// sets the prior flag, or COLMAP's default. Any other camera counts as given: tools often leave the flag at 0.
IntrinsicsOrigin OriginOfStoredCamera(const Camera& camera);
// Returns the camera with every focal length of its model multiplied by the factor.
Camera WithFocalFactor(const Camera& camera, double factor);

// Returns the camera with its principal point moved; unchanged if the model has none.
Camera WithShiftedPrincipalPoint(const Camera& camera, const Eigen::Vector2d& shift_px);
// Returns the coefficients of the third and fifth power of the model's radial distortion; nullopt if it lacks either.
std::optional<Eigen::Vector2d> RadialDistortion(const Camera& camera);
// Returns the camera with other such coefficients. The model must have them.
Camera WithRadialDistortion(const Camera& camera, const Eigen::Vector2d& coefficients);
// Returns a SIMPLE_RADIAL or RADIAL camera as OPENCV, which has a second focal length and a second radial coefficient;
// any other camera as it is.
Camera AsOpenCv(const Camera& camera);
// Returns the log of the ratio of the focal lengths in y and x; 0 for a model with one focal length.
double LogAspectRatio(const Camera& camera);
// Returns the camera with its focal length in y longer by this factor than that in x, relative to before, and the
// product of both as before; unchanged for a model with one focal length.
Camera WithAspectFactor(const Camera& camera, double factor);

// Returns the mean focal length of the camera's model in pixels; nullopt if the model has none.
std::optional<double> MeanFocalLengthPx(const Camera& camera);
// Returns the camera for images turned by 90 degrees, clockwise or counterclockwise: the principal point is in the
// centre and directed distortion is left out, because these are the means of both cases.
Camera Transposed(const Camera& camera);

// Returns the viewing ray (unit length, camera coordinates) of an image point in pixels. nullopt if the camera model
// cannot be inverted at this point.
using RayInCamFunction = std::function<std::optional<Eigen::Vector3d>(const Eigen::Vector2d& xy)>;
// Returns this function of a camera, which is converted to COLMAP's type once for many points.
RayInCamFunction RaysInCam(const Camera& camera);

// Returns the image point (pixels) of a point in camera coordinates. nullopt if the camera model cannot project it, for
// example from behind a pinhole camera.
std::optional<Eigen::Vector2d> ImageFromCam(const Camera& camera, const Eigen::Vector3d& point_in_cam);

}  // namespace lazyloc
