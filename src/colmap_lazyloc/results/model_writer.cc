#include "colmap_lazyloc/results/model_writer.h"

#include <limits>
#include <vector>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/formats/geo_file.h"
#include "colmap_lazyloc/results/point_merger.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr uint64_t kNoPoint = std::numeric_limits<uint64_t>::max();
constexpr size_t kMaxNumObservationsInMemory = 1 << 18;

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

// Visits the observations of one image after the other, in the order of image ids and keypoints.
class ImageWriter {
 public:
  ImageWriter(const std::filesystem::path& path, const Model& model, const MergedModel& merged,
              const QueryRecords& records, const DatabaseContent& database)
      : model_(model),
        merged_(merged),
        records_(records),
        database_(database),
        next_image_(merged.images.begin()),
        file_(path) {
    file_.WriteBinary<uint64_t>(merged.images.size());
  }

  void Add(const PointObservation& observation) {
    while (next_image_->image_id != observation.image_id) WriteNextImage();
    observations_.push_back(observation);
  }

  void Close() {
    while (next_image_ != merged_.images.end()) WriteNextImage();
    file_.Close();
  }

 private:
  void WriteNextImage() {
    const MergedImage& image = *next_image_++;
    if (image.is_query) {
      const QueryRecord record = records_.Read(image.index, RecordParts::KEYPOINTS);
      const std::string& name = record.result.query_name;
      WriteImage(image, name, record.result.cam_from_world,
                 record.keypoints.empty() ? ReadKeypoints(name) : record.keypoints);
    } else {
      const ModelImage& posed = model_.images[image.index];
      WriteImage(image, posed.name, posed.cam_from_world,
                 observations_.empty() ? std::vector<Eigen::Vector2d>() : ReadKeypoints(posed.name));
    }
    observations_.clear();
  }

  // Returns none for a photo without keypoints, which other images of its rig have localized.
  std::vector<Eigen::Vector2d> ReadKeypoints(const std::string& name) const {
    const DatabaseImage* image = FindByName(database_.images, name);
    if (image == nullptr) return {};
    std::vector<Eigen::Vector2d> keypoints = database_.reader.ReadKeypointsOnce(image->image_id);
    return keypoints.empty() && database_.extracted_keypoints ? database_.extracted_keypoints(name) : keypoints;
  }

  void WriteImage(const MergedImage& image, const std::string& name, const Rigid3d& cam_from_world,
                  const std::vector<Eigen::Vector2d>& keypoints) {
    file_.WriteBinary<uint32_t>(image.image_id);
    WritePose(cam_from_world, &file_);
    file_.WriteBinary<uint32_t>(image.camera_id);
    file_.Text() << name << '\0';
    LAZYLOC_CHECK(observations_.empty() || observations_.back().keypoint < keypoints.size());
    file_.WriteBinary<uint64_t>(keypoints.size());
    size_t next = 0;
    for (uint32_t i = 0; i < keypoints.size(); ++i) {
      file_.WriteBinary<double>(keypoints[i].x());
      file_.WriteBinary<double>(keypoints[i].y());
      const bool has_point = next < observations_.size() && observations_[next].keypoint == i;
      file_.WriteBinary<uint64_t>(has_point ? observations_[next++].point_id : kNoPoint);
    }
  }

  const Model& model_;
  const MergedModel& merged_;
  const QueryRecords& records_;
  const DatabaseContent database_;
  std::vector<MergedImage>::const_iterator next_image_;
  std::vector<PointObservation> observations_;  // of the next image, by keypoint
  OutputFile file_;
};

}  // namespace

void WriteModel(const std::filesystem::path& folder, const std::filesystem::path& scratch_file, const Model& model,
                const QueryRecords& records, const DatabaseContent& database) {
  const MergedModel merged = MergeModel(model, records, database.images);
  WriteCameras(folder / "cameras.bin", merged.cameras);
  if (!merged.rigs.empty()) {
    WriteRigs(folder / "rigs.bin", merged.rigs);
    WriteFrames(folder / "frames.bin", merged.frames);
  }
  WriteAxes(folder, model.axes);
  ExternalSorter<PointObservation> observations(scratch_file, kMaxNumObservationsInMemory);
  WritePoints(folder / "points3D.bin", model, merged, records, database.was_matched_with_them, &observations);
  ImageWriter images(folder / "images.bin", model, merged, records, database);
  observations.Visit([&](const PointObservation& observation) { images.Add(observation); });
  images.Close();
}

}  // namespace lazyloc
