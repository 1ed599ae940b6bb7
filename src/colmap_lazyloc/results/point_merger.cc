#include "colmap_lazyloc/results/point_merger.h"

#include <optional>
#include <unordered_map>
#include <vector>

#include "colmap_lazyloc/files/output_file.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

class PointWriter {
 public:
  PointWriter(const std::filesystem::path& path, const Model& model, const MergedModel& merged,
              const QueryRecords& records, const std::function<bool(const QueryRecord&)>& was_matched,
              ExternalSorter<PointObservation>* observations)
      : model_(model),
        merged_(merged),
        records_(records),
        was_matched_(was_matched),
        observations_(*observations),
        file_(path) {
    file_.WriteBinary<uint64_t>(0);  // the number of points, which is known at the end
  }

  void WriteAll() {
    for (size_t i = 0; i < records_.Size(); ++i) {
      if (merged_.image_of_query[i] != MergedModel::kNoImage) AddQuery(i);
    }
    file_.Text().seekp(0);
    file_.WriteBinary<uint64_t>(num_points_);
    file_.Close();
  }

 private:
  void AddQuery(size_t index) {
    const QueryRecord record = records_.Read(index, RecordParts::ALL);
    if (was_matched_ && !was_matched_(record)) return;
    const LocalizationResult& query = record.result;
    const uint32_t query_image = merged_.image_of_query[index];
    std::vector<uint32_t> pair_images;
    for (const PairResult& pair : query.pairs) pair_images.push_back(ImageOf(pair.database_name));
    for (const PointResult& point : query.points) AddPoint(point, query_image, pair_images);
    // Only the points of its own pairs observe an image that is not of the database.
    if (FindByName(model_.images, query.query_name) == nullptr) is_observed_.erase(query_image);
  }

  // Returns kNoImage if the merged model does not have the image.
  uint32_t ImageOf(const std::string& name) const {
    if (const std::optional<size_t> query = records_.Find(name)) return merged_.image_of_query[*query];
    const ModelImage* image = FindByName(model_.images, name);
    return image == nullptr ? MergedModel::kNoImage : image->image_id;
  }

  void AddPoint(const PointResult& point, uint32_t query_image, const std::vector<uint32_t>& pair_images) {
    std::vector<PointObservation> track;
    const auto observe = [&](uint32_t image_id, int keypoint) {
      LAZYLOC_CHECK(keypoint >= 0);
      const auto index = static_cast<uint32_t>(keypoint);
      std::vector<bool>& is_observed = is_observed_[image_id];
      if (is_observed.size() <= index) is_observed.resize(index + 1);
      if (is_observed[index]) return;
      is_observed[index] = true;
      track.push_back({image_id, index, num_points_ + 1});
    };
    observe(query_image, point.query_point);
    for (const auto& [pair_idx, keypoint] : point.observations) {
      const uint32_t image_id = pair_images.at(static_cast<size_t>(pair_idx));
      if (image_id != MergedModel::kNoImage) observe(image_id, keypoint);
    }
    if (track.size() < 2) {
      for (const PointObservation& element : track) is_observed_[element.image_id][element.keypoint] = false;
      return;
    }
    file_.WriteBinary<uint64_t>(++num_points_);
    for (const double coordinate : point.point_in_world) file_.WriteBinary<double>(coordinate);
    for (int channel = 0; channel < 3; ++channel) file_.WriteBinary<uint8_t>(0);  // black: no image is read
    // Keeps the error of the whole track, even if an observation has gone to another point.
    file_.WriteBinary<double>(point.mean_reprojection_error_px);
    file_.WriteBinary<uint64_t>(track.size());
    for (const PointObservation& element : track) {
      file_.WriteBinary<uint32_t>(element.image_id);
      file_.WriteBinary<uint32_t>(element.keypoint);
      observations_.Add(element);
    }
  }

  const Model& model_;
  const MergedModel& merged_;
  const QueryRecords& records_;
  const std::function<bool(const QueryRecord&)>& was_matched_;
  ExternalSorter<PointObservation>& observations_;
  OutputFile file_;
  std::unordered_map<uint32_t, std::vector<bool>> is_observed_;  // keypoints that observe a point already, by image
  uint64_t num_points_ = 0;
};

}  // namespace

void WritePoints(const std::filesystem::path& path, const Model& model, const MergedModel& merged,
                 const QueryRecords& records, const std::function<bool(const QueryRecord&)>& was_matched,
                 ExternalSorter<PointObservation>* observations) {
  PointWriter(path, model, merged, records, was_matched, observations).WriteAll();
}

}  // namespace lazyloc
