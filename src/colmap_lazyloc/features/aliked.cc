#include "colmap_lazyloc/features/aliked.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "colmap_lazyloc/features/contrast.h"
#include "colmap_lazyloc/files/checksum.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/scene/options_check.h"
#include "colmap_lazyloc/scene/quarter_turns.h"

namespace lazyloc {
namespace {

// COLMAP's defaults: minimum score of a feature; minimum cosine of matched descriptors and maximum ratio of the
// distances of the nearest two, of which 1 allows any; minimum score of a match of LightGlue.
constexpr float kMinScore = 0.2f, kMinCosine = 0.85f, kMaxRatio = 1, kMinMatchScore = 0.1f;

namespace fs = std::filesystem;

constexpr double kMaxIndex = 1e9;
constexpr int kSizeMultiple = 32;  // of the images that the extractor takes
constexpr auto kFloat = OnnxNode::Type::FLOAT, kInteger = OnnxNode::Type::INTEGER;

// Returns the file of a folder whose name ends with this one, because COLMAP puts a checksum in front of the names of
// the models that it downloads; the file of this very name if there is one. Returns an empty path if there is none.
fs::path FindModel(const std::string& folder, const std::string& name) {
  std::error_code ignored;
  fs::path found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ignored)) {
    const std::string file_name = entry.path().filename().string();
    const bool has_name =
        file_name.size() >= name.size() && file_name.compare(file_name.size() - name.size(), name.size(), name) == 0;
    if (!has_name || !entry.is_regular_file(ignored)) continue;
    if (file_name == name) return entry.path();
    found = found.empty() ? entry.path() : std::min(found, entry.path());
  }
  return found;
}

fs::path NeedModel(const std::string& folder, const std::string& name) {
  if (folder.empty()) {
    throw InputError("photos need the ONNX models of ALIKED features: name the folder that has " + name +
                     " by --onnx_path");
  }
  const fs::path path = FindModel(folder, name);
  if (path.empty()) throw InputError("option --onnx_path: " + folder + " has no file " + name);
  return path;
}

const char* NameOf(MatcherType matcher) {
  LAZYLOC_CHECK(matcher == MatcherType::ALIKED_BRUTEFORCE || matcher == MatcherType::ALIKED_LIGHTGLUE);
  return matcher == MatcherType::ALIKED_BRUTEFORCE ? "bruteforce-matcher.onnx" : "aliked-lightglue.onnx";
}

OnnxModel LoadExtractor(FeatureType type, const AlikedOptions& options) {
  LAZYLOC_CHECK(IsAliked(type));
  return {NeedModel(options.onnx_path, type == FeatureType::ALIKED_N32 ? "aliked-n32.onnx" : "aliked-n16rot.onnx"),
          {{"image", kFloat, {-1, 3, -1, -1}}, {"max_keypoints", kInteger, {}}, {"min_score", kFloat, {}}},
          {{"keypoints", kFloat, {-1, -1, 2}},
           {"descriptors", kFloat, {-1, -1, kDescriptorLength}},
           {"scores", kFloat, {-1, -1}}}};
}

OnnxModel LoadMatcher(MatcherType matcher, const AlikedOptions& options) {
  constexpr int kLength = kDescriptorLength;
  const fs::path path = NeedModel(options.onnx_path, NameOf(matcher));
  if (matcher == MatcherType::ALIKED_BRUTEFORCE) {
    return {path,
            {{"descs1", kFloat, {-1, kLength}},
             {"descs2", kFloat, {-1, kLength}},
             {"min_cossim", kFloat, {}},
             {"max_ratio", kFloat, {}},
             {"cross_check", kInteger, {}}},
            {{"idx0", kInteger, {-1}}, {"idx1", kInteger, {-1}}, {"scores", kFloat, {-1}}}};
  }
  return {path,
          {{"kpts0", kFloat, {-1, -1, 2}},
           {"kpts1", kFloat, {-1, -1, 2}},
           {"desc0", kFloat, {-1, -1, kLength}},
           {"desc1", kFloat, {-1, -1, kLength}},
           {"image_size0", kFloat, {-1, 2}},
           {"image_size1", kFloat, {-1, 2}}},
          {{"matches0", std::nullopt, {-1}}, {"mscores0", kFloat, {-1}}}};
}

int RoundUp(int size) { return (size + kSizeMultiple - 1) / kSizeMultiple * kSizeMultiple; }

// Returns the colours from 0 to 1, one plane each, enlarged by repeating the last column and row.
OnnxTensor ToTensor(const RgbImage& image, const Contrast& contrast) {
  const int width = RoundUp(image.width), height = RoundUp(image.height);
  const float scale = 1.0f / static_cast<float>(contrast.white - contrast.black);
  std::vector<float> values;
  values.reserve(size_t{3} * static_cast<size_t>(width) * static_cast<size_t>(height));
  for (int channel = 0; channel < 3; ++channel) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const int pixel = std::min(y, image.height - 1) * image.width + std::min(x, image.width - 1);
        const int value = image.values[static_cast<size_t>(3 * pixel + channel)];
        values.push_back(static_cast<float>(std::clamp(value, contrast.black, contrast.white) - contrast.black) *
                         scale);
      }
    }
  }
  return {{1, 3, height, width}, std::move(values)};
}

OnnxTensor Scalar(float value) { return {{}, std::vector<float>{value}}; }
OnnxTensor Scalar(int64_t value) { return {{}, std::vector<int64_t>{value}}; }

OnnxTensor DescriptorTensor(const Features& features, std::vector<int64_t> shape) {
  LAZYLOC_CHECK(static_cast<size_t>(features.descriptors.cols()) == kDescriptorLength * sizeof(float));
  std::vector<float> values(static_cast<size_t>(features.descriptors.size()) / sizeof(float));
  std::memcpy(values.data(), features.descriptors.data(), values.size() * sizeof(float));
  return {std::move(shape), std::move(values)};
}

// LightGlue sees an image as its features were extracted: turned upright. COLMAP takes the turns from the image's
// gravity, which a database need not have.
int TurnsOf(const Features& features) { return TurnsBeforeExtraction(features.keypoints.front()); }

// LightGlue's pixels begin in the centre of the first one, COLMAP's in its corner.
OnnxTensor KeypointTensor(const Features& features, const Camera& camera) {
  const int quarter_turns = TurnsOf(features);
  std::vector<float> values;
  for (const Keypoint& stored : features.keypoints) {
    const Keypoint keypoint =
        Turned(stored, quarter_turns, static_cast<float>(camera.width), static_cast<float>(camera.height));
    values.insert(values.end(), {keypoint.x - 0.5f, keypoint.y - 0.5f});
  }
  return {{1, static_cast<int64_t>(features.keypoints.size()), 2}, std::move(values)};
}

OnnxTensor SizeTensor(const Features& features, const Camera& camera) {
  std::vector<float> size = {static_cast<float>(camera.width), static_cast<float>(camera.height)};
  if (TurnsOf(features) % 2 == 1) std::swap(size[0], size[1]);
  return {{1, 2}, std::move(size)};
}

}  // namespace

bool AlikedOptions::Check(std::string* error) const {
  if (max_num_features >= 1) return true;
  *error = "AlikedExtraction.max_num_features must be >= 1, but is " + std::to_string(max_num_features);
  return false;
}

bool HasMatcher(MatcherType matcher, const AlikedOptions& options) {
  return !FindModel(options.onnx_path, NameOf(matcher)).empty();
}

Aliked::Aliked(FeatureType type, MatcherType matcher, const AlikedOptions& options)
    : type_(type),
      matcher_type_(matcher),
      options_(options),
      extractor_(LoadExtractor(type, options)),
      matcher_(LoadMatcher(matcher, options)),
      key_(Format("%s upright %d %d %d %s", EnumName(type), options.max_image_size, options.max_num_features,
                  static_cast<int>(options.has_full_contrast), FileContent(extractor_.Path()).c_str())) {}

void Aliked::LoadModels() const {
  extractor_.Load();
  matcher_.Load();
}

std::string Aliked::Describe() const {
  return Format(": at most %d features of ALIKED in at most %d pixels, matched by %s", options_.max_num_features,
                options_.max_image_size, EnumName(matcher_type_));
}

Features Aliked::Extract(const PhotoFile& photo, double, IdleThreads*) const {
  const RgbImage image = photo.ToRgb(options_.max_image_size);
  const Contrast contrast = options_.has_full_contrast ? FullContrast(image.values) : Contrast();
  const std::vector<OnnxTensor> outputs =
      extractor_.Run({ToTensor(image, contrast), Scalar(int64_t{options_.max_num_features}), Scalar(kMinScore)});
  const std::vector<float>&xys = outputs[0].Floats(), &descriptors = outputs[1].Floats(), &scores = outputs[2].Floats();
  if (xys.size() != 2 * scores.size() || descriptors.size() != kDescriptorLength * scores.size()) {
    extractor_.Fail("keypoints, descriptors and scores differ in number");
  }
  // Keypoints are from -1 to 1 between the centres of the first and the last pixel of the enlarged image.
  const float scale_x = 0.5f * static_cast<float>(RoundUp(image.width) - 1);
  const float scale_y = 0.5f * static_cast<float>(RoundUp(image.height) - 1);
  const auto width = static_cast<float>(image.width), height = static_cast<float>(image.height);
  const PhotoProperties& file = photo.Properties();
  const bool is_swapped = file.quarter_turns % 2 == 1;
  const float file_scale_x = static_cast<float>(file.width) / (is_swapped ? height : width);
  const float file_scale_y = static_cast<float>(file.height) / (is_swapped ? width : height);
  Features features;
  features.type = type_;
  std::vector<float> kept;
  for (size_t i = 0; i < scores.size(); ++i) {
    const float x = (xys[2 * i] + 1) * scale_x + 0.5f, y = (xys[2 * i + 1] + 1) * scale_y + 0.5f;
    const bool is_inside = x >= 0 && y >= 0 && x < width && y < height;
    if (!is_inside || !(scores[i] >= kMinScore)) continue;
    features.keypoints.push_back(
        Scaled(Turned({x, y}, TurnsBack(file.quarter_turns), width, height), file_scale_x, file_scale_y));
    kept.insert(kept.end(), &descriptors[kDescriptorLength * i],
                &descriptors[kDescriptorLength * i] + kDescriptorLength);
  }
  features.descriptors.resize(static_cast<Eigen::Index>(features.keypoints.size()), kDescriptorLength * sizeof(float));
  if (!kept.empty()) std::memcpy(features.descriptors.data(), kept.data(), kept.size() * sizeof(float));
  return features;
}

Matches Aliked::Match(const Features& query, const Camera& query_camera, const Features& database,
                      const Camera& database_camera) const {
  LAZYLOC_CHECK(query.type == type_ && database.type == type_);
  // The brute-force model looks for a second neighbour.
  if (query.keypoints.size() < 2 || database.keypoints.size() < 2) return {};
  Matches matches = matcher_type_ == MatcherType::ALIKED_BRUTEFORCE
                        ? MatchByBruteForce(query, database)
                        : MatchByLightGlue(query, query_camera, database, database_camera);
  std::sort(matches.begin(), matches.end());
  return matches;
}

Matches Aliked::MatchByBruteForce(const Features& query, const Features& database) const {
  const auto tensor = [](const Features& features) {
    return DescriptorTensor(features, {features.descriptors.rows(), kDescriptorLength});
  };
  const std::vector<OnnxTensor> outputs =
      matcher_.Run({tensor(query), tensor(database), Scalar(kMinCosine), Scalar(kMaxRatio), Scalar(int64_t{1})});
  const std::vector<int64_t>&of_query = outputs[0].Integers(), &of_database = outputs[1].Integers();
  if (of_query.size() != of_database.size()) matcher_.Fail("the two images differ in their number of matches");
  Matches matches;
  for (size_t i = 0; i < of_query.size(); ++i) {
    matches.push_back(MakeMatch(of_query[i], of_database[i], query, database));
  }
  return matches;
}

Matches Aliked::MatchByLightGlue(const Features& query, const Camera& query_camera, const Features& database,
                                 const Camera& database_camera) const {
  const auto tensor = [](const Features& features) {
    return DescriptorTensor(features, {1, features.descriptors.rows(), kDescriptorLength});
  };
  const std::vector<OnnxTensor> outputs =
      matcher_.Run({KeypointTensor(query, query_camera), KeypointTensor(database, database_camera), tensor(query),
                    tensor(database), SizeTensor(query, query_camera), SizeTensor(database, database_camera)});
  // COLMAP's model may write the indices as floats. -1: no match.
  std::vector<int64_t> neighbours;
  const auto add = [&](const auto& values) {
    for (const auto value : values) {
      neighbours.push_back(value >= 0 ? static_cast<int64_t>(std::min<double>(static_cast<double>(value), kMaxIndex))
                                      : -1);
    }
  };
  std::visit(add, outputs[0].values);
  const std::vector<float>& scores = outputs[1].Floats();
  if (neighbours.size() != query.keypoints.size() || scores.size() != neighbours.size()) {
    matcher_.Fail("there are not as many matches as keypoints");
  }
  Matches matches;
  for (size_t i = 0; i < scores.size(); ++i) {
    if (neighbours[i] < 0 || !(scores[i] >= kMinMatchScore)) continue;
    matches.push_back(MakeMatch(static_cast<int64_t>(i), neighbours[i], query, database));
  }
  return matches;
}

lazyloc::Match Aliked::MakeMatch(int64_t query_point, int64_t other_point, const Features& query,
                                 const Features& database) const {
  const auto has = [](const Features& features, int64_t point) {
    return point >= 0 && point < static_cast<int64_t>(features.keypoints.size());
  };
  if (!has(query, query_point) || !has(database, other_point))
    matcher_.Fail("a match names a keypoint that is not there");
  return {static_cast<uint32_t>(query_point), static_cast<uint32_t>(other_point)};
}

}  // namespace lazyloc
