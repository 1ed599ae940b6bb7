#include "colmap_lazyloc/features/coarse_features.h"

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/features/descriptor_matching.h"
#include "colmap_lazyloc/features/feature_statistics.h"
#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/scene/format.h"

namespace lazyloc {
namespace {

// Of a photo that is read: a quarter of 12 megapixels in each direction.
constexpr int kMaxSize = 1008;
constexpr int kMaxNumFeatures = 1500;

std::optional<Features> Extract(const std::filesystem::path& path) {
  const std::optional<PhotoFile> photo = PhotoFile::ReadReduced(path, kMaxSize);
  if (!photo) return std::nullopt;
  SiftExtractionOptions options;
  options.max_image_size = kMaxSize;
  options.max_num_features = kMaxNumFeatures;
  options.first_octave = 0;
  IdleThreads none(0);  // because each image has a thread
  return photo->ExtractFeatures(options, &none);
}

}  // namespace

std::optional<Features> CoarseExtraction::Get(const std::string& image_name) const {
  const std::filesystem::path path = image_path_ / image_name;
  const std::string key = Format("coarse SIFT %d %d ", kMaxSize, kMaxNumFeatures);
  return kept_.Get(image_name, path, key, FeatureType::SIFT, [&] { return Extract(path); });
}

CoarseFeatures::CoarseFeatures(const CoarseExtraction& extraction, const std::map<uint32_t, std::string>& names,
                               IdleThreads* idle_threads)
    : image_path_(extraction.ImagePath()) {
  const std::vector<std::pair<uint32_t, std::string>> images(names.begin(), names.end());
  std::vector<std::optional<Features>> features(images.size());
  ParallelFor(
      images.size(), [&](size_t i) { features[i] = extraction.Get(images[i].second); }, idle_threads);
  uint32_t checksum = 0;
  for (size_t i = 0; i < images.size(); ++i) {
    if (!features[i]) continue;
    const Descriptors& descriptors = features[i]->descriptors;
    checksum = Crc32({reinterpret_cast<const char*>(descriptors.data()), static_cast<size_t>(descriptors.size())},
                     Crc32(images[i].second, checksum));
    features_.emplace(images[i].first, std::move(*features[i]));
  }
  state_ = Format("coarse %zu %08x", features_.size(), checksum);
}

DescriptorCounts CoarseFeatures::Counts() const {
  DescriptorCounts counts;
  for (const auto& [image_id, features] : features_) {
    if (!features.keypoints.empty()) counts.of_image.emplace(image_id, features.keypoints.size());
  }
  return counts;
}

std::vector<size_t> CountCoarseMatches(const Features& query,
                                       const std::vector<std::shared_ptr<const std::optional<Features>>>& coarse,
                                       IdleThreads* idle_threads) {
  const Descriptors largest = query.descriptors(IndicesOfLargest(query.keypoints, kMaxNumFeatures), Eigen::all);
  std::vector<size_t> counts(coarse.size());
  ParallelFor(
      coarse.size(),
      [&](size_t i) {
        if (*coarse[i]) counts[i] = MatchDescriptors(largest, (*coarse[i])->descriptors).size();
      },
      idle_threads);
  return counts;
}

}  // namespace lazyloc
