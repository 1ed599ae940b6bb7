#pragma once

#include <filesystem>
#include <string>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/learned/onnx_model.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"
#include "colmap_lazyloc/scene/matcher_type.h"

namespace lazyloc {

// How ALIKED features are extracted, with the names and defaults of COLMAP 4.
struct AlikedOptions {
  std::string onnx_path;      // folder with models, whose names end with COLMAP's
  int max_image_size = 1600;  // in pixels, of the longer side; larger photos are scaled down
  int max_num_features = 2048;
  // Spreads a photo's values from black to white, because the network sees little in haze or at night; COLMAP does not.
  bool has_full_contrast = false;

  bool Check(std::string* error) const;
};

// True if the folder has the model of this matcher, which is one for ALIKED.
bool HasMatcher(MatcherType matcher, const AlikedOptions& options);

// Extracts and matches ALIKED features by COLMAP 4's ONNX models. Zhao et al., ALIKED: A Lighter Keypoint and
// Descriptor Extraction Network via Deformable Transformation, TIM 2023. Lindenberger et al., LightGlue: Local Feature
// Matching at Light Speed, ICCV 2023.
class Aliked {
 public:
  // type, matcher: those of ALIKED. Throws InputError naming the option if a model is missing.
  Aliked(FeatureType type, MatcherType matcher, const AlikedOptions& options);
  // Loads the models now rather than with the first photo. Throws InputError naming the file of another model.
  void LoadModels() const;

  FeatureType Type() const { return type_; }
  MatcherType Matcher() const { return matcher_type_; }
  const AlikedOptions& Options() const { return options_; }
  // Returns a line for the user on how photos are extracted and matched.
  std::string Describe() const;
  const std::filesystem::path& ExtractorPath() const { return extractor_.Path(); }

  // Return the features, with keypoints in pixels of the file, and the sorted matches. Throw InputError naming the file
  // if a model's output makes no sense. Thread-safe; use the calling thread alone.
  Features Extract(const PhotoFile& photo) const;
  Matches Match(const Features& query, const Camera& query_camera, const Features& database,
                const Camera& database_camera) const;

 private:
  Matches MatchByBruteForce(const Features& query, const Features& database) const;
  Matches MatchByLightGlue(const Features& query, const Camera& query_camera, const Features& database,
                           const Camera& database_camera) const;

  // Checks that both images have these keypoints.
  lazyloc::Match MakeMatch(int64_t query_point, int64_t other_point, const Features& query,
                           const Features& database) const;

  const FeatureType type_;
  const MatcherType matcher_type_;
  const AlikedOptions options_;
  const OnnxModel extractor_, matcher_;
};

}  // namespace lazyloc
