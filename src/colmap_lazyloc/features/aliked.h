#pragma once

#include <filesystem>
#include <string>

#include "colmap_lazyloc/features/feature_method.h"
#include "colmap_lazyloc/onnx/onnx_model.h"

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
class Aliked : public FeatureMethod {
 public:
  // type, matcher: those of ALIKED. Throws InputError naming the option if a model is missing.
  Aliked(FeatureType type, MatcherType matcher, const AlikedOptions& options);

  FeatureType Type() const override { return type_; }
  MatcherType Matcher() const override { return matcher_type_; }
  std::string Describe() const override;
  std::string Key() const override { return key_; }
  bool NeedsColours() const override { return true; }
  void LoadModels() const override;
  // Extract and Match throw InputError naming the file if a model's output makes no sense.
  Features Extract(const PhotoFile& photo, double focal_length_px, IdleThreads* idle_threads) const override;
  Matches Match(const Features& query, const Camera& query_camera, const Features& database,
                const Camera& database_camera) const override;

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
  const std::string key_;
};

}  // namespace lazyloc
