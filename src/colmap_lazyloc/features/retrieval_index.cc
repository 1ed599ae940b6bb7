#include "colmap_lazyloc/features/retrieval_index.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <optional>
#include <random>
#include <system_error>
#include <type_traits>

#include "colmap_lazyloc/features/feature_statistics.h"
#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/files/staged_output.h"
#include "colmap_lazyloc/math/descriptor_products.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/model.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

namespace fs = std::filesystem;

constexpr char kMagic[] = "colmap_lazyloc retrieval index ", kVersion[] = "3";
// Size of the sample that the vocabulary is learnt from: more descriptors per word make it slower, not better.
constexpr size_t kDescriptorsPerWord = 16;
// What a feature takes in the inverted files, image and signature, and what a word takes in the vocabulary.
constexpr uint64_t kBytesPerFeature = 12, kBytesPerWord = kDescriptorLength;
// What numbers of a unit vector are multiplied by to become bytes: few exceed 0.35.
constexpr float kByteScale = 360;

template <typename T>
void WriteNumber(T number, std::ofstream* file) {
  static_assert(std::is_arithmetic_v<T>);
  file->write(reinterpret_cast<const char*>(&number), sizeof(number));
}

void WriteText(const std::string& text, std::ofstream* file) {
  WriteNumber<uint64_t>(text.size(), file);
  *file << text;
}

template <typename T>
T ReadNumber(std::ifstream* file) {
  T number{};
  file->read(reinterpret_cast<char*>(&number), sizeof(number));
  return number;
}

std::string ReadText(std::ifstream* file) {
  std::string text(ReadNumber<uint64_t>(file), ' ');
  file->read(text.data(), static_cast<std::streamsize>(text.size()));
  return text;
}

size_t NumIndexed(size_t num_features, int max_num_features) {
  return max_num_features < 0 ? num_features : std::min<size_t>(num_features, max_num_features);
}

// Returns descriptors as bytes, which visual words are made of. Distances keep their order but for rounding.
Descriptors AsBytes(const Features& features) {
  if (features.type == FeatureType::SIFT) return features.descriptors;
  LAZYLOC_CHECK(IsAliked(features.type));
  Descriptors bytes(features.descriptors.rows(), kDescriptorLength);
  for (Eigen::Index i = 0; i < bytes.rows(); ++i) {
    std::array<float, kDescriptorLength> values;
    std::memcpy(values.data(), features.descriptors.row(i).data(), sizeof(values));
    for (int k = 0; k < kDescriptorLength; ++k) {
      const float value = std::round(128 + kByteScale * values[static_cast<size_t>(k)]);
      bytes(i, k) = value > 0 ? static_cast<uint8_t>(std::min(value, 255.0f)) : 0;  // 0 if it is not a number
    }
  }
  return bytes;
}

size_t NumWords(uint64_t num_features, const RetrievalOptions& options) {
  return std::max<uint64_t>(2, std::min<uint64_t>(options.num_visual_words, num_features / kDescriptorsPerWord));
}

uint32_t ChecksumOf(const Descriptors& descriptors) {
  return Crc32({reinterpret_cast<const char*>(descriptors.data()), static_cast<size_t>(descriptors.size())});
}

// Returns nullopt if the features are damaged, and then sets `damage`.
std::optional<Features> ReadFeatures(const FeatureSource& reader, uint32_t image_id, std::string* damage) {
  try {
    return reader.Read(image_id);
  } catch (const DamagedRecordError& error) {
    *damage = error.what();
    return std::nullopt;
  }
}

// Returns the descriptors of an image that are indexed, or of a query that are looked up: those of the largest scales.
// ALIKED's, whose scales are equal, begin with the best ones.
Descriptors ChooseDescriptors(const Features& features, int max_num_features) {
  const size_t num_features = features.keypoints.size(), num_indexed = NumIndexed(num_features, max_num_features);
  Descriptors descriptors = AsBytes(features);
  if (num_indexed == num_features) return descriptors;
  return descriptors(IndicesOfLargest(features.keypoints, num_indexed), Eigen::all);
}

// Returns the descriptors that the vocabulary is learnt from. Reads evenly spaced images of a large database, because
// reading takes longer than what follows, and draws about a tenth of their descriptors.
Descriptors SampleDescriptors(const std::vector<DatabaseImage>& images, const FeatureSource& features,
                              int max_num_features, size_t num_available, size_t num_wanted, int seed) {
  const size_t step = std::max<size_t>(1, num_available / (8 * num_wanted));
  const double ratio = std::min(1.0, static_cast<double>(step * num_wanted) / static_cast<double>(num_available));
  std::mt19937 random(static_cast<uint32_t>(seed));
  Descriptors sample(static_cast<Eigen::Index>(std::min(num_available, num_wanted + num_wanted / 8 + 1000)),
                     kDescriptorLength);
  Eigen::Index num_rows = 0;
  std::string ignored;  // AddNewEntries reports it
  for (size_t image = 0; image < images.size(); image += step) {
    const std::optional<Features> read = ReadFeatures(features, images[image].image_id, &ignored);
    if (!read) continue;
    const Descriptors descriptors = ChooseDescriptors(*read, max_num_features);
    for (Eigen::Index i = 0; i < descriptors.rows() && num_rows < sample.rows(); ++i) {
      // Uses the generator's own numbers, because distributions differ between standard libraries.
      if (static_cast<double>(random()) < ratio * 4294967296.0) sample.row(num_rows++) = descriptors.row(i);
    }
  }
  sample.conservativeResize(num_rows, Eigen::NoChange);
  return sample;
}

}  // namespace

bool RetrievalOptions::Check(std::string* error) const {
  OPTION_GE(num_visual_words, 2);
  if (max_num_features < 1 && max_num_features != -1) {
    *error = "max_num_features must be >= 1, or -1";
    return false;
  }
  return true;
}

std::string IndexEstimate::Text() const {
  const uint64_t num_megabytes = num_bytes / 1000000 + 1;
  return std::to_string(num_images) + " images, " + std::to_string(num_features) + " features: about " +
         std::to_string(num_megabytes) + " MB of memory and of disk";
}

IndexEstimate EstimateIndex(const DatabaseReader& database, const RetrievalOptions& options) {
  IndexEstimate estimate;
  for (const auto& [image_id, count] : FeatureReader(database.Path()).ReadDescriptorCounts().of_image) {
    ++estimate.num_images;
    estimate.num_features += NumIndexed(count, options.max_num_features);
  }
  estimate.num_bytes =
      estimate.num_features * kBytesPerFeature + NumWords(estimate.num_features, options) * kBytesPerWord;
  return estimate;
}

RetrievalIndex::RetrievalIndex(const fs::path& path, const DatabaseReader& database, const RetrievalOptions& options,
                               int seed, int num_threads)
    : RetrievalIndex(path, database.ReadImages(), FeatureReader(database.Path()), options, seed, num_threads) {}

RetrievalIndex::RetrievalIndex(const fs::path& path, const std::vector<DatabaseImage>& images,
                               const FeatureSource& features, const RetrievalOptions& options, int seed,
                               int num_threads)
    : seed_(seed) {
  const std::string state = features.StateText();  // before anything is read
  const DescriptorCounts counts = features.Counts();
  type_ = counts.type;
  std::vector<DatabaseImage> described;
  for (const DatabaseImage& image : images) {
    if (counts.of_image.count(image.image_id) > 0) described.push_back(image);
  }
  if (described.empty()) throw InputError(features.Path().string() + ": no descriptors to make an index from");
  if (type_ != FeatureType::SIFT && !IsAliked(type_)) {
    throw InputError(features.Path().string() + ": has features of type " + EnumName(type_) +
                     ", but an index needs those of SIFT or ALIKED");
  }

  std::error_code ignored;
  if (!path.empty() && fs::exists(path, ignored)) {
    Read(path);
    const auto is_known = [&](const auto& entry) { return FindByName(described, entry.first) != nullptr; };
    if (std::none_of(entries_.begin(), entries_.end(), is_known)) {
      throw InputError(
          path.string() +
          ": none of its images is in the database: it belongs to another one (delete it to make it again)");
    }
    RemoveStale(described, counts, features, /*reads_descriptors=*/state != database_state_);
  }
  IdleThreads idle_threads(EffectiveNumThreads(num_threads) - 1);
  // Removed images stay in the inverted files, unused, and a vocabulary learnt from few images does not suit many.
  const size_t num_unused = static_cast<size_t>(next_index_id_ - 1) - entries_.size();
  const bool is_outgrown = num_unused > entries_.size() || described.size() > 8 * entries_.size();
  if (!visual_index_ || is_outgrown) Train(described, features, options, &idle_threads);
  AddNewEntries(described, features, &idle_threads);
  for (const DatabaseImage& image : described) {
    const auto entry = entries_.find(image.name);
    if (entry != entries_.end()) image_of_index_id_[entry->second.index_id] = image.image_id;
  }
  const bool has_changed = changes_.is_trained || changes_.num_added > 0 || changes_.num_removed > 0;
  if (path.empty() || (!has_changed && state == database_state_)) return;
  database_state_ = state;
  try {
    Write(path);
  } catch (const InputError&) {
    if (has_changed) throw;  // else the next run only takes longer
  }
}

void RetrievalIndex::RemoveStale(const std::vector<DatabaseImage>& images, const DescriptorCounts& counts,
                                 const FeatureSource& features, bool reads_descriptors) {
  std::string ignored;  // AddNewEntries reports it
  const auto is_current = [&](const std::string& name, const Entry& entry) {
    const DatabaseImage* image = FindByName(images, name);
    if (image == nullptr || counts.of_image.at(image->image_id) != entry.num_descriptors) return false;
    if (!reads_descriptors) return true;
    const std::optional<Features> read = ReadFeatures(features, image->image_id, &ignored);
    return read && ChecksumOf(read->descriptors) == entry.checksum;
  };
  for (auto entry = entries_.begin(); entry != entries_.end();) {
    const bool is_stale = !is_current(entry->first, entry->second);
    changes_.num_removed += is_stale;
    entry = is_stale ? entries_.erase(entry) : std::next(entry);
  }
}

void RetrievalIndex::Train(const std::vector<DatabaseImage>& images, const FeatureSource& features,
                           const RetrievalOptions& options, IdleThreads* idle_threads) {
  entries_.clear();
  next_index_id_ = 1;
  max_num_features_ = options.max_num_features;
  changes_.is_trained = true;
  size_t num_available = 0;
  for (const auto& [image_id, count] : features.Counts().of_image) {
    num_available += NumIndexed(count, max_num_features_);
  }
  const size_t num_words = NumWords(num_available, options);
  const Descriptors sample =
      SampleDescriptors(images, features, max_num_features_, num_available, num_words * kDescriptorsPerWord, seed_);
  if (sample.rows() == 0) {
    throw InputError(features.Path().string() + ": the descriptors of all images are damaged: no index can be made");
  }
  visual_index_ = std::make_unique<VisualIndex>(
      VisualWords::Train(sample, static_cast<int>(num_words), static_cast<uint32_t>(seed_), idle_threads));
}

void RetrievalIndex::AddNewEntries(const std::vector<DatabaseImage>& images, const FeatureSource& features,
                                   IdleThreads* idle_threads) {
  for (const DatabaseImage& image : images) {
    if (entries_.count(image.name) > 0) continue;
    std::string damage;
    const std::optional<Features> read = ReadFeatures(features, image.image_id, &damage);
    if (!read) {
      warnings_.push_back(damage + ": leaving the image out");
      continue;
    }
    const Entry entry = {next_index_id_++, static_cast<uint64_t>(read->descriptors.rows()),
                         ChecksumOf(read->descriptors)};
    visual_index_->Add(entry.index_id, ChooseDescriptors(*read, max_num_features_), idle_threads);
    entries_.emplace(image.name, entry);
    ++changes_.num_added;
  }
}

std::vector<uint32_t> RetrievalIndex::Query(const Features& query, IdleThreads* idle_threads) const {
  LAZYLOC_CHECK(query.type == type_);
  std::vector<uint32_t> image_ids;
  for (const auto& [index_id, score] :
       visual_index_->Query(ChooseDescriptors(query, max_num_features_), idle_threads)) {
    const auto image = image_of_index_id_.find(index_id);
    if (image != image_of_index_id_.end()) image_ids.push_back(image->second);
  }
  return image_ids;
}

std::string RetrievalIndex::Header() const {
  const std::string type = type_ == FeatureType::SIFT ? "" : std::string(" ") + EnumName(type_);
  return std::string(kMagic) + kVersion + type;
}

void RetrievalIndex::Write(const fs::path& path) const {
  StagedOutput staged(path.parent_path(), path);
  const std::string name = path.filename().string();
  std::ofstream file(staged / name, std::ios::binary | std::ios::trunc);
  file << Header() << '\n';
  WriteText(database_state_, &file);
  WriteNumber<int32_t>(max_num_features_, &file);
  WriteNumber<int32_t>(next_index_id_, &file);
  WriteNumber<uint64_t>(entries_.size(), &file);
  for (const auto& [image_name, entry] : entries_) {
    WriteNumber(entry.index_id, &file);
    WriteNumber(entry.num_descriptors, &file);
    WriteNumber(entry.checksum, &file);
    WriteText(image_name, &file);
  }
  if (file) visual_index_->Write(&file);
  file.flush();
  WriteNumber(Crc32OfFile(staged / name), &file);
  file.close();
  if (!file) throw InputError(path.string() + ": the retrieval index cannot be written");
  staged.Publish({name});
}

void RetrievalIndex::Read(const fs::path& path) {
  std::error_code ignored;
  const auto fail = [&](const std::string& problem) {
    throw InputError(path.string() + ": " + problem + " (delete it to make it again)");
  };
  std::ifstream file(path, std::ios::binary);
  std::string header;
  std::getline(file, header);
  if (!file || header.rfind(kMagic, 0) != 0) fail("is not a retrieval index of colmap lazy_indexer");
  if (header.rfind(std::string(kMagic) + kVersion, 0) != 0) fail("was made by another version of the program");
  if (header != Header()) fail("is of another type of features");
  // Checks everything before it is used, because a damaged length could ask for any amount of memory.
  const uint64_t num_bytes = fs::file_size(path, ignored) - sizeof(uint32_t);
  const std::streampos begin = file.tellg();
  file.seekg(static_cast<std::streamoff>(num_bytes));
  if (ReadNumber<uint32_t>(&file) != Crc32OfFile(path, num_bytes) || !file) fail("is truncated or damaged");
  file.seekg(begin);
  database_state_ = ReadText(&file);
  max_num_features_ = ReadNumber<int32_t>(&file);
  next_index_id_ = ReadNumber<int32_t>(&file);
  const auto num_entries = ReadNumber<uint64_t>(&file);
  for (uint64_t i = 0; i < num_entries && file; ++i) {
    Entry entry;
    entry.index_id = ReadNumber<int32_t>(&file);
    entry.num_descriptors = ReadNumber<uint64_t>(&file);
    entry.checksum = ReadNumber<uint32_t>(&file);
    entries_.emplace(ReadText(&file), entry);
  }
  visual_index_ = std::make_unique<VisualIndex>(VisualIndex::Read(&file));
  if (!file) fail("is damaged");
}

}  // namespace lazyloc
