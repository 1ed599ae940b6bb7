#include "colmap_lazyloc/io/model_writer.h"

#include <limits>
#include <vector>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr uint64_t kNoPoint = std::numeric_limits<uint64_t>::max();

void WriteCameras(const std::filesystem::path& path, const std::map<uint32_t, Camera>& cameras) {
  OutputFile file(path);
  file.WriteBinary<uint64_t>(cameras.size());
  for (const auto& [camera_id, camera] : cameras) {
    file.WriteBinary<uint32_t>(camera_id);
    file.WriteBinary<int32_t>(camera.model_id);
    file.WriteBinary<uint64_t>(camera.width);
    file.WriteBinary<uint64_t>(camera.height);
    for (const double param : camera.params) file.WriteBinary<double>(param);
  }
  file.Close();
}

void WritePose(const Rigid3d& pose, OutputFile* file) {
  for (const double number : {pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z(),
                              pose.translation.x(), pose.translation.y(), pose.translation.z()}) {
    file->WriteBinary<double>(number);
  }
}

void WriteSensor(const Sensor& sensor, OutputFile* file) {
  file->WriteBinary<int32_t>(static_cast<int32_t>(sensor.type));
  file->WriteBinary<uint32_t>(sensor.sensor_id);
}

void WriteRigs(const std::filesystem::path& path, const std::map<uint32_t, Rig>& rigs) {
  OutputFile file(path);
  file.WriteBinary<uint64_t>(rigs.size());
  for (const auto& [rig_id, rig] : rigs) {
    file.WriteBinary<uint32_t>(rig_id);
    file.WriteBinary<uint32_t>(static_cast<uint32_t>(rig.reference.has_value() + rig.others.size()));
    if (rig.reference) WriteSensor(*rig.reference, &file);
    for (const RigSensor& other : rig.others) {
      WriteSensor(other.sensor, &file);
      file.WriteBinary<uint8_t>(other.sensor_from_rig.has_value());
      if (other.sensor_from_rig) WritePose(*other.sensor_from_rig, &file);
    }
  }
  file.Close();
}

void WriteFrames(const std::filesystem::path& path, const std::map<uint32_t, ModelFrame>& frames) {
  OutputFile file(path);
  file.WriteBinary<uint64_t>(frames.size());
  for (const auto& [frame_id, frame] : frames) {
    file.WriteBinary<uint32_t>(frame_id);
    file.WriteBinary<uint32_t>(frame.rig_id);
    WritePose(frame.rig_from_world, &file);
    file.WriteBinary<uint32_t>(static_cast<uint32_t>(frame.data.size()));
    for (const FrameData& data : frame.data) {
      WriteSensor(data.sensor, &file);
      file.WriteBinary<uint64_t>(data.data_id);
    }
  }
  file.Close();
}

void WriteImagePoints(const MergedImage& image, const DatabaseReader& database, OutputFile* file) {
  std::vector<Eigen::Vector2d> keypoints = image.photo_keypoints;
  if (image.database_id) keypoints = database.ReadKeypoints(*image.database_id);
  const auto& point_of_keypoint = image.point_of_keypoint;
  LAZYLOC_CHECK(point_of_keypoint.empty() || point_of_keypoint.rbegin()->first < keypoints.size());

  file->WriteBinary<uint64_t>(keypoints.size());
  for (uint32_t i = 0; i < keypoints.size(); ++i) {
    file->WriteBinary<double>(keypoints[i].x());
    file->WriteBinary<double>(keypoints[i].y());
    const auto point = point_of_keypoint.find(i);
    file->WriteBinary<uint64_t>(point == point_of_keypoint.end() ? kNoPoint : point->second);
  }
}

void WriteImages(const std::filesystem::path& path, const std::map<uint32_t, MergedImage>& images,
                 const DatabaseReader& database) {
  OutputFile file(path);
  file.WriteBinary<uint64_t>(images.size());
  for (const auto& [image_id, merged_image] : images) {
    const ModelImage& image = merged_image.image;
    file.WriteBinary<uint32_t>(image_id);
    WritePose(image.cam_from_world, &file);
    file.WriteBinary<uint32_t>(image.camera_id);
    file.Text() << image.name << '\0';
    WriteImagePoints(merged_image, database, &file);
  }
  file.Close();
}

void WritePoints(const std::filesystem::path& path, const std::vector<MergedPoint>& points) {
  OutputFile file(path);
  file.WriteBinary<uint64_t>(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const MergedPoint& point = points[i];
    file.WriteBinary<uint64_t>(i + 1);
    for (const double coordinate : point.point_in_world) file.WriteBinary<double>(coordinate);
    for (int channel = 0; channel < 3; ++channel) file.WriteBinary<uint8_t>(0);  // black: no image is read
    file.WriteBinary<double>(point.mean_reprojection_error_px);
    file.WriteBinary<uint64_t>(point.track.size());
    for (const TrackElement& element : point.track) {
      file.WriteBinary<uint32_t>(element.image_id);
      file.WriteBinary<uint32_t>(element.keypoint);
    }
  }
  file.Close();
}

}  // namespace

void WriteModel(const std::filesystem::path& folder, const MergedModel& model, const DatabaseReader& database) {
  WriteCameras(folder / "cameras.bin", model.cameras);
  if (!model.rigs.empty()) {
    WriteRigs(folder / "rigs.bin", model.rigs);
    WriteFrames(folder / "frames.bin", model.frames);
  }
  WriteImages(folder / "images.bin", model.images, database);
  WritePoints(folder / "points3D.bin", model.points);
}

}  // namespace lazyloc
