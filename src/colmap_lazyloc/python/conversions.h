#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/python/python_localizer.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/model.h"

// Conversions between C++ and what crosses the border to Python: numpy arrays, numbers and strings. The Python package
// has checked and copied arrays before, so that they have these types. A pose has seven numbers: qw qx qy qz tx ty tz.
namespace lazyloc {

template <typename Value, int num_columns>
using InputRows = nanobind::ndarray<const Value, nanobind::shape<-1, num_columns>, nanobind::c_contig,
                                    nanobind::device::cpu, nanobind::ro>;
using InputPoints = InputRows<double, 2>;
using InputMatches = InputRows<uint32_t, 2>;
using InputPoses = InputRows<double, 7>;
using InputPixels = nanobind::ndarray<const uint8_t, nanobind::ndim<3>, nanobind::c_contig, nanobind::device::cpu,
                                      nanobind::ro>;  // rows, columns, 1 (grey) or 3 (RGB) values
using OutputRows = nanobind::ndarray<nanobind::numpy, double, nanobind::ndim<2>>;
using OutputIndices = nanobind::ndarray<nanobind::numpy, int32_t, nanobind::ndim<1>>;
using OutputIndexRows = nanobind::ndarray<nanobind::numpy, int32_t, nanobind::ndim<2>>;

// Returns rows of two numbers: points or matches.
template <typename Row, typename Rows>
std::vector<Row> ToRows(const Rows& rows) {
  std::vector<Row> result(rows.shape(0));
  for (size_t i = 0; i < result.size(); ++i) result[i] = {rows(i, 0), rows(i, 1)};
  return result;
}
// Throws InputError if a pose is not finite or its quaternion is not of unit length.
std::vector<Rigid3d> ToPoses(const InputPoses& poses);

// Throws InputError if the camera cannot be used.
Camera MakeCamera(const std::string& model, uint64_t width, uint64_t height, const std::vector<double>& params);
// Returns the viewing rays of points in pixels, n x 3, of unit length; NaN where the camera model has none.
OutputRows ToRays(const Camera& camera, const InputPoints& points);
// Makes a model without points. camera_of_image: index into `cameras`. Throws InputError for data that a model cannot
// have.
Model MakeModel(const std::vector<Camera>& cameras, const std::vector<std::string>& names, const InputPoses& poses,
                const std::vector<size_t>& camera_of_image);

// A model's cameras: id, model, width, height and parameters of each. Its images in the order of their file: the name;
// image id, camera id, place and length of the points in the file; the pose. The file of the images.
using OutputCamera = std::tuple<uint32_t, std::string, uint64_t, uint64_t, std::vector<double>>;
using OutputNumbers = nanobind::ndarray<nanobind::numpy, uint64_t, nanobind::ndim<2>>;
using OutputModel =
    std::tuple<std::vector<OutputCamera>, std::vector<nanobind::bytes>, OutputNumbers, OutputRows, std::string>;
OutputModel ToOutput(const ModelOnDisk& read);

// The query's name; its line of results.jsonl; its keypoints, n x 2; the points that it observes, m x 3, and the
// keypoint of each; their observations in database images, k x 3: index of the point, index into `pairs` of the line,
// keypoint of the database image.
using OutputAnswer = std::tuple<std::string, std::string, OutputRows, OutputRows, OutputIndices, OutputIndexRows>;
// axes: of the model.
std::vector<OutputAnswer> ToOutput(const std::vector<QueryRecord>& records, const WorldAxes& axes);

}  // namespace lazyloc
