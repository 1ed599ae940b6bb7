#include "colmap_lazyloc/python/conversions.h"

#include <algorithm>
#include <limits>
#include <memory>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/formats/model_builder.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/results/result_text.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {

namespace nb = nanobind;

namespace {

// Hands an array to numpy, which frees it.
template <typename Array, typename Value>
Array ToNumpy(std::vector<Value> values, std::initializer_list<size_t> shape) {
  auto owned = std::make_unique<std::vector<Value>>(std::move(values));
  Value* const data = owned->data();
  const nb::capsule owner(owned.release(), [](void* p) noexcept { delete static_cast<std::vector<Value>*>(p); });
  return Array(data, shape, owner);
}

template <int num_columns>
OutputRows PointsToNumpy(const std::vector<Eigen::Vector<double, num_columns>>& points) {
  std::vector<double> values;
  for (const auto& point : points) values.insert(values.end(), point.begin(), point.end());
  return ToNumpy<OutputRows>(std::move(values), {points.size(), num_columns});
}

OutputAnswer ToOutput(const QueryRecord& record, const WorldAxes& axes) {
  const std::vector<PointResult>& points = record.result.points;
  std::vector<double> positions;
  std::vector<int32_t> indices, observations;
  for (const PointResult& point : points) {
    positions.insert(positions.end(), point.point_in_world.begin(), point.point_in_world.end());
    const auto point_index = static_cast<int32_t>(indices.size());
    indices.push_back(point.query_point);
    for (const auto& [pair, keypoint] : point.observations) {
      observations.insert(observations.end(), {point_index, pair, keypoint});
    }
  }
  const size_t num_observations = observations.size() / 3;
  return {record.result.query_name,
          ResultLine(record, axes),
          PointsToNumpy(record.keypoints),
          ToNumpy<OutputRows>(std::move(positions), {points.size(), 3}),
          ToNumpy<OutputIndices>(std::move(indices), {points.size()}),
          ToNumpy<OutputIndexRows>(std::move(observations), {num_observations, 3})};
}

void ThrowIf(const std::string& problem) {
  if (!problem.empty()) throw InputError("model: " + problem);
}

Rigid3d ToPose(const double* v) { return {{v[0], v[1], v[2], v[3]}, {v[4], v[5], v[6]}}; }

}  // namespace

std::vector<Rigid3d> ToPoses(const InputPoses& poses) {
  std::vector<Rigid3d> result;
  for (size_t i = 0; i < poses.shape(0); ++i) {
    const Rigid3d pose = ToPose(&poses(i, 0));
    if (!IsUnitQuaternion(pose.rotation) || !pose.translation.allFinite()) {
      throw InputError("pose " + std::to_string(i) + " is not a unit quaternion with a translation");
    }
    result.push_back({pose.rotation.normalized(), pose.translation});
  }
  return result;
}

Camera MakeCamera(const std::string& model, uint64_t width, uint64_t height, const std::vector<double>& params) {
  const std::optional<int> model_id = CameraModelId(model);
  if (!model_id) throw InputError("unknown camera model '" + model + "'");
  Camera camera = {0, *model_id, width, height, params, /*has_prior_focal_length=*/true};
  if (const std::string problem = CameraProblem(camera); !problem.empty()) throw InputError("camera: " + problem);
  return camera;
}

OutputRows ToRays(const Camera& camera, const InputPoints& points) {
  const RayInCamFunction ray_in_cam = RaysInCam(camera);
  const Eigen::Vector3d none = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  std::vector<Eigen::Vector3d> rays;
  for (const Eigen::Vector2d& point : ToRows<Eigen::Vector2d>(points)) rays.push_back(ray_in_cam(point).value_or(none));
  return PointsToNumpy(rays);
}

Model MakeModel(const std::vector<Camera>& cameras, const std::vector<std::string>& names, const InputPoses& poses,
                const std::vector<size_t>& camera_of_image) {
  LAZYLOC_CHECK(names.size() == poses.shape(0) && names.size() == camera_of_image.size());
  ModelBuilder builder;
  for (size_t i = 0; i < cameras.size(); ++i) {
    Camera camera = cameras[i];
    camera.camera_id = static_cast<uint32_t>(i) + 1;
    ThrowIf(builder.Add(std::move(camera)));
  }
  for (size_t i = 0; i < names.size(); ++i) {
    const auto camera_id = static_cast<uint32_t>(camera_of_image[i]) + 1;
    ThrowIf(builder.Add(ModelImage{static_cast<uint32_t>(i) + 1, camera_id, names[i], ToPose(&poses(i, 0))}));
  }
  Model model = builder.Take();
  if (model.images.empty()) throw InputError("model: contains no posed image");
  return model;
}

OutputModel ToOutput(const ModelOnDisk& read) {
  std::vector<OutputCamera> cameras;
  for (const auto& [camera_id, camera] : read.model.cameras) {
    cameras.emplace_back(camera_id, CameraModelName(camera.model_id), camera.width, camera.height, camera.params);
  }
  std::vector<std::pair<PointsPlace, const ModelImage*>> images;
  for (const ModelImage& image : read.model.images) images.emplace_back(read.points.at(image.image_id), &image);
  std::sort(images.begin(), images.end(), [](const auto& a, const auto& b) { return a.first.offset < b.first.offset; });
  std::vector<nb::bytes> names;
  std::vector<uint64_t> numbers;
  std::vector<double> poses;
  for (const auto& [place, image] : images) {
    names.emplace_back(image->name.data(), image->name.size());
    numbers.insert(numbers.end(), {image->image_id, image->camera_id, place.offset, place.num_bytes});
    const auto& [rotation, translation] = image->cam_from_world;
    poses.insert(poses.end(), {rotation.w(), rotation.x(), rotation.y(), rotation.z()});
    poses.insert(poses.end(), translation.begin(), translation.end());
  }
  return {std::move(cameras), std::move(names), ToNumpy<OutputNumbers>(std::move(numbers), {images.size(), 4}),
          ToNumpy<OutputRows>(std::move(poses), {images.size(), 7}), read.images_path.string()};
}

std::vector<OutputAnswer> ToOutput(const std::vector<QueryRecord>& records, const WorldAxes& axes) {
  std::vector<OutputAnswer> outputs;
  for (const QueryRecord& record : records) outputs.push_back(ToOutput(record, axes));
  return outputs;
}

}  // namespace lazyloc
