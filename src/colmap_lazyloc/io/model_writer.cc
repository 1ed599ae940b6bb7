#include "colmap_lazyloc/io/model_writer.h"

#include <limits>
#include <vector>

#include "colmap_lazyloc/io/output_file.h"
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
    const Rigid3d& pose = image.cam_from_world;
    for (const double number : {pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z(),
                                pose.translation.x(), pose.translation.y(), pose.translation.z()}) {
      file.WriteBinary<double>(number);
    }
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
  WriteImages(folder / "images.bin", model.images, database);
  WritePoints(folder / "points3D.bin", model.points);
}

}  // namespace lazyloc
