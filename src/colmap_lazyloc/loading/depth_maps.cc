#include "colmap_lazyloc/loading/depth_maps.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>
#include <system_error>

#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/scene/format.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// Maximum relative difference of the aspect ratios of map and image: a small map has a rounded size.
constexpr double kMaxAspectDifference = 0.03;
// A jump is a gap between neighbouring depths by more than this ratio that makes up most of their range.
constexpr float kMinJump = 0.1F;
constexpr float kMinJumpShare = 0.5F;

// Endings of a map's name after the whole name of its image, and instead of the image's ending. The last one follows
// the image's name without `.color`, as RGB-D datasets name their files.
constexpr std::array<const char*, 5> kEndings = {".png", ".npy", ".geometric.bin", ".photometric.bin", ".bin"};
constexpr std::array<const char*, 6> kEndingsOfStem = {".png",       ".npy",      ".geometric.bin", ".photometric.bin",
                                                       ".depth.png", ".depth.npy"};

// Returns true if the depths next to a pixel are those of two surfaces.
bool HasJump(const DepthMap& map, int x, int y) {
  std::array<float, 9> known;
  size_t num_known = 0;
  for (int row = std::max(y - 1, 0); row <= std::min(y + 1, map.height - 1); ++row) {
    for (int col = std::max(x - 1, 0); col <= std::min(x + 1, map.width - 1); ++col) {
      if (map.At(col, row) > 0) known[num_known++] = map.At(col, row);
    }
  }
  std::sort(known.begin(), known.begin() + num_known);
  for (size_t i = 1; i < num_known; ++i) {
    const float gap = known[i] - known[i - 1];
    if (gap > kMinJump * known[i - 1] && gap > kMinJumpShare * (known[num_known - 1] - known[0])) return true;
  }
  return false;
}

// Interpolates inverse depths, because those of a plane are linear in the pixel; nullopt if a neighbour is unknown.
std::optional<float> Interpolate(const DepthMap& map, double x, double y) {
  const double left = std::floor(x), upper = std::floor(y);
  const int col = static_cast<int>(left), row = static_cast<int>(upper);
  if (col < 0 || row < 0 || col + 1 >= map.width || row + 1 >= map.height) return std::nullopt;
  double inverse = 0;
  for (const int i : {0, 1}) {
    for (const int j : {0, 1}) {
      const float depth = map.At(col + j, row + i);
      if (!(depth > 0)) return std::nullopt;
      inverse += std::abs(x - left - (1 - j)) * std::abs(y - upper - (1 - i)) / depth;
    }
  }
  return static_cast<float>(1 / inverse);
}

size_t HashOf(const std::vector<Eigen::Vector2d>& keypoints) {
  const auto* bytes = reinterpret_cast<const char*>(keypoints.data());
  return std::hash<std::string_view>()({bytes, keypoints.size() * sizeof(Eigen::Vector2d)});
}

void CheckSize(const DepthMap& map, const Camera& camera, const std::filesystem::path& path) {
  const double ratio = static_cast<double>(map.width) * static_cast<double>(camera.height) /
                       (static_cast<double>(map.height) * static_cast<double>(camera.width));
  if (std::abs(std::log(ratio)) <= kMaxAspectDifference) return;
  throw InputError(path.string() + Format(": measures %d x %d pixels, which is not the aspect ratio of its image with "
                                          "%zu x %zu",
                                          map.width, map.height, size_t{camera.width}, size_t{camera.height}));
}

}  // namespace

bool DepthMapOptions::Check(std::string* error) const {
  OPTION_GT(png_unit, 0);
  return true;
}

float DepthAt(const DepthMap& map, const Camera& camera, const Eigen::Vector2d& xy) {
  // The centre of the upper left pixel is at (0.5, 0.5) in both.
  const double x = xy.x() * map.width / static_cast<double>(camera.width) - 0.5;
  const double y = xy.y() * map.height / static_cast<double>(camera.height) - 0.5;
  if (!(x >= -0.5 && y >= -0.5 && x <= map.width - 0.5 && y <= map.height - 0.5)) return 0;
  const int nearest_x = std::min(static_cast<int>(std::lround(x)), map.width - 1);
  const int nearest_y = std::min(static_cast<int>(std::lround(y)), map.height - 1);
  const float nearest = map.At(nearest_x, nearest_y);
  if (!(nearest > 0) || HasJump(map, nearest_x, nearest_y)) return 0;
  return Interpolate(map, x, y).value_or(nearest);
}

DepthMaps::DepthMaps(const DepthMapOptions& options)
    : options_(options),
      cache_([](const Sampled& sampled) { return sizeof(Sampled) + sizeof(float) * sampled.depths.size(); }) {
  std::error_code error;
  if (!std::filesystem::is_directory(options.depth_path, error)) {
    throw InputError("depth_path " + options.depth_path + " is not a folder");
  }
}

// Returns an empty path if there is no map.
std::filesystem::path DepthMaps::FindFile(const std::string& image_name) const {
  const std::filesystem::path whole = std::filesystem::path(options_.depth_path) / image_name;
  std::filesystem::path stem = whole;
  stem.replace_extension();
  std::vector<std::filesystem::path> candidates;
  for (const char* ending : kEndings) candidates.push_back(whole.string() + ending);
  for (const char* ending : kEndingsOfStem) candidates.push_back(stem.string() + ending);
  if (stem.extension() == ".color") {
    stem.replace_extension();
    for (const char* ending : {".depth.png", ".depth.npy"}) candidates.push_back(stem.string() + ending);
  }
  std::error_code error;
  for (const std::filesystem::path& path : candidates) {
    if (std::filesystem::is_regular_file(path, error)) return path;
  }
  return {};
}

DepthMaps::Sampled DepthMaps::Sample(const std::string& image_name, const Camera& camera,
                                     const std::vector<Eigen::Vector2d>& keypoints) const {
  Sampled sampled{HashOf(keypoints), {}};
  std::string problem;
  try {
    const std::filesystem::path path = FindFile(image_name);
    if (!path.empty()) {
      const DepthMap map = ReadDepthMap(path, options_.png_unit);
      CheckSize(map, camera, path);
      if (std::none_of(map.depths.begin(), map.depths.end(), [](float depth) { return depth > 0; })) {
        throw InputError(path.string() + ": has no known depth");
      }
      sampled.depths.reserve(keypoints.size());
      for (const Eigen::Vector2d& xy : keypoints) sampled.depths.push_back(DepthAt(map, camera, xy));
      return sampled;
    }
  } catch (const InputError& error) {
    problem = error.what();
  }
  const std::lock_guard<std::mutex> lock(problems_mutex_);
  problem_of_image_.emplace(image_name, problem);
  return sampled;
}

std::vector<float> DepthMaps::AtKeypoints(const std::string& image_name, uint32_t image_id, const Camera& camera,
                                          const std::vector<Eigen::Vector2d>& keypoints) const {
  const auto sample = [&] { return Sample(image_name, camera, keypoints); };
  const auto kept = cache_.Get(image_id, sample);
  // Samples anew if a caller brought keypoints of its own.
  return kept->keypoints_hash == HashOf(keypoints) ? kept->depths : sample().depths;
}

std::vector<std::string> DepthMaps::Problems() const {
  const std::lock_guard<std::mutex> lock(problems_mutex_);
  std::vector<std::string> lines;
  for (const auto& [name, problem] : problem_of_image_) {
    if (!problem.empty()) lines.push_back("no depth for image " + name + ": " + problem);
  }
  return lines;
}

std::string DepthMaps::MissingMaps() const {
  const std::lock_guard<std::mutex> lock(problems_mutex_);
  std::string example;
  size_t num_missing = 0;
  for (const auto& [name, problem] : problem_of_image_) {
    if (problem.empty() && num_missing++ == 0) example = name;
  }
  if (num_missing == 0) return "";
  return "no depth map for " + std::to_string(num_missing) + " database images (for example " + example + ") in " +
         options_.depth_path;
}

}  // namespace lazyloc
