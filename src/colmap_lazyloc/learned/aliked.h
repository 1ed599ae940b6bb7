#pragma once

#include <string>

#include "colmap_lazyloc/bridge/feature_extraction.h"
#include "colmap_lazyloc/learned/onnx_model.h"
#include "colmap_lazyloc/scene/camera.h"
#include "colmap_lazyloc/scene/features.h"
#include "colmap_lazyloc/scene/match.h"

namespace lazyloc {

enum class AlikedMatcher { BRUTE_FORCE, LIGHTGLUE };
template <>
inline constexpr std::array kEnumNames<AlikedMatcher> = {"ALIKED_BRUTEFORCE", "ALIKED_LIGHTGLUE"};

// Options for ALIKED features, with the names and defaults of COLMAP 4.
struct AlikedOptions {
  std::string onnx_path;  // folder with models under COLMAP's names; the paths of single models precede it
  int max_image_size = 1600, max_num_features = 2048;
  std::string n16rot_model_path, n32_model_path;
  AlikedMatcher matcher = AlikedMatcher::BRUTE_FORCE;
  std::string bruteforce_model_path;
  std::string lightglue_model_path;

  bool Check(std::string* error) const;
};

// Extracts and matches ALIKED features by COLMAP 4's ONNX models. Zhao et al., ALIKED: A Lighter Keypoint and
// Descriptor Extraction Network via Deformable Transformation, TIM 2023. Lindenberger et al., LightGlue: Local Feature
// Matching at Light Speed, ICCV 2023.
class Aliked {
 public:
  // type: one of ALIKED. Throws InputError naming the option or file if a model is missing or another one.
  Aliked(FeatureType type, const AlikedOptions& options);

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
  const AlikedOptions options_;
  const OnnxModel extractor_, matcher_;
};

}  // namespace lazyloc
