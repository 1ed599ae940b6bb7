#include "colmap_lazyloc/epoch/epoch_cameras.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {
namespace {

// What photos of one camera have in common.
using CameraKey = std::tuple<int, uint64_t, uint64_t, std::vector<double>, std::string>;

CameraKey KeyOf(const Camera& camera, const std::string& owner) {
  return {camera.model_id, camera.width, camera.height, camera.params, owner};
}

// Returns the camera of a localized photo if it is one of the model, somebody has given it, or several photos have
// determined it; else nullopt.
std::optional<JointCamera> FindKnownCamera(const Model& model, const LocalizationResult& result) {
  for (const auto& id_and_camera : model.cameras) {
    if (SameIntrinsics(id_and_camera.second, result.query_camera)) return JointCamera{id_and_camera.second, true};
  }
  const bool is_given = result.intrinsics.origin == IntrinsicsOrigin::GIVEN && !result.is_camera_refined;
  const bool is_joint = !result.intrinsics.covariance.isZero(0);
  if (!is_given && !is_joint) return std::nullopt;
  return JointCamera{result.query_camera, true, result.intrinsics.covariance};
}

// Returns the camera that a single photo has determined. Adjustment would estimate it again from the same matches, but
// without what localization knows of its uncertainty: in photos of level ground, the focal length can then be wrong by
// many standard deviations.
JointCamera CameraOf(const LocalizationResult& result) {
  JointCamera camera{result.query_camera, true};
  camera.covariance(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR) =
      std::pow(result.intrinsics.focal_factor_stddev / result.intrinsics.focal_factor, 2);
  return camera;
}

// Returns the median of each parameter, of the cameras with the most frequent model.
Camera MedianCamera(const std::vector<const LocalizationResult*>& localized) {
  std::map<int, int> counts;
  for (const LocalizationResult* result : localized) ++counts[result->query_camera.model_id];
  const auto most =
      std::max_element(counts.begin(), counts.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  std::vector<std::vector<double>> values;
  Camera median;
  for (const LocalizationResult* result : localized) {
    const Camera& camera = result->query_camera;
    if (camera.model_id != most->first) continue;
    if (values.empty()) median = camera;
    values.resize(camera.params.size());
    for (size_t i = 0; i < values.size(); ++i) values[i].push_back(camera.params[i]);
  }
  for (size_t i = 0; i < values.size(); ++i) median.params[i] = Median(values[i]);
  return median;
}

}  // namespace

std::vector<EpochCamera> ChooseCameras(const Model& model, const DatabaseReader& database, bool shares,
                                       std::vector<EpochPhoto>* photos) {
  std::map<CameraKey, int> camera_of_key, camera_of_stored;
  std::vector<EpochCamera> cameras;
  std::vector<std::vector<const LocalizationResult*>> localized;  // by camera
  const auto find_or_add = [&](const CameraKey& key, const JointCamera& camera) {
    const auto [entry, is_new] = camera_of_key.emplace(key, static_cast<int>(cameras.size()));
    if (is_new) {
      cameras.push_back({camera, 0});
      localized.emplace_back();
    }
    return entry->second;
  };
  const std::vector<DatabaseImage> images = database.ReadImages();
  std::vector<std::pair<EpochPhoto*, Camera>> rest;  // photos without a pose
  for (EpochPhoto& photo : *photos) {
    if (!photo.database_id) continue;
    const Camera stored = database.ReadCamera(FindByName(images, photo.Name())->camera_id);
    if (!photo.is_placed) {
      rest.emplace_back(&photo, stored);
      continue;
    }
    const CameraKey stored_key = KeyOf(stored, shares ? "" : photo.Name());
    const std::optional<JointCamera> known = FindKnownCamera(model, photo.record.result);
    photo.camera = known ? find_or_add(KeyOf(known->camera, "known"), *known) : find_or_add(stored_key, {stored});
    camera_of_stored.emplace(stored_key, photo.camera);
    ++cameras[photo.camera].num_photos;
    localized[photo.camera].push_back(&photo.record.result);
  }
  for (const auto& [photo, stored] : rest) {
    const CameraKey key = KeyOf(stored, shares ? "" : photo->Name());
    const auto entry = camera_of_stored.find(key);
    photo->camera = entry != camera_of_stored.end() ? entry->second : find_or_add(key, {stored});
  }
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i].is_constant || localized[i].empty()) continue;
    const LocalizationResult& first = *localized[i].front();
    if (shares && localized[i].size() == 1 && first.is_camera_refined) {
      static_cast<JointCamera&>(cameras[i]) = CameraOf(first);
    } else {
      cameras[i].camera = MedianCamera(localized[i]);
    }
  }
  return cameras;
}

}  // namespace lazyloc
