#include "colmap_lazyloc/pipeline/lazy_localizer.h"

#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/pipeline/focal_length.h"
#include "colmap_lazyloc/pipeline/group_partition.h"
#include "colmap_lazyloc/pipeline/localize_lone.h"
#include "colmap_lazyloc/pipeline/localize_together.h"

namespace lazyloc {
namespace {

using Results = std::vector<LocalizationResult>;

// Moves the results of some images to their places among those of all.
void Store(Results results, const std::vector<int>& images, Results* all) {
  for (size_t i = 0; i < images.size(); ++i) (*all)[images[i]] = std::move(results[i]);
}

// Localizes the frames together; those that fail leave the group, one by one, and are localized individually.
Results LocalizeFrames(const QueryGroup& group, const LocalizerOptions& options) {
  Results results(group.images.size());
  std::vector<int> images(group.images.size());  // those that are still together
  std::iota(images.begin(), images.end(), 0);
  QueryGroup rest;
  for (const QueryGroup* together = &group;; together = &rest) {
    Outcome outcome = LocalizeTogether(*together, options);
    if (outcome.failed_frames.empty() || together->frame_names.size() == 1) {
      Store(std::move(outcome.results), images, &results);
      return results;
    }
    const auto in_group = [&](const std::vector<int>& selected) {
      std::vector<int> indices;
      for (const int i : selected) indices.push_back(images[i]);
      return indices;
    };
    for (const int frame : outcome.failed_frames) {
      const std::vector<int> of_frame = ImagesOfFrames(*together, {frame});
      QueryGroup alone = SelectImages(*together, of_frame);
      Store(of_frame.size() == 1 ? Results{LocalizeLone(alone, options)} : LocalizeTogether(alone, options).results,
            in_group(of_frame), &results);
    }
    const std::vector<int> others = ImagesOfOtherFrames(*together, outcome.failed_frames);
    if (others.empty()) return results;
    QueryGroup next = SelectImages(*together, others);
    images = in_group(others);
    rest = std::move(next);
  }
}

// Returns the scale of a frame from the results of its images when each is localized individually: the median over
// pairs of images of the ratio of their distances; nullopt if no two images with different places are localized.
std::optional<double> EstimateScale(const QueryGroup& group, const Results& individual, int frame) {
  std::vector<double> ratios;
  const auto distance = [](const Rigid3d& a, const Rigid3d& b) { return (CamInWorld(a) - CamInWorld(b)).norm(); };
  const auto is_used = [&](size_t i) { return group.images[i].frame == frame && HasPose(individual[i].status); };
  for (size_t i = 0; i < individual.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (!is_used(i) || !is_used(j)) continue;
      const double given = distance(group.images[i].cam_from_rig, group.images[j].cam_from_rig);
      if (given > 0) ratios.push_back(distance(individual[i].cam_from_world, individual[j].cam_from_world) / given);
    }
  }
  if (ratios.empty()) return std::nullopt;
  const double scale = Median(std::move(ratios));
  return scale > 0 ? std::make_optional(scale) : std::nullopt;
}

// Localizes frames whose translations have no scale. Starts from the scale that the images give individually; if they
// give none, their own results are returned.
Results LocalizeWithoutScale(QueryGroup group, const LocalizerOptions& options) {
  Results individual(group.images.size());
  for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
    individual[i] = LocalizeLone(SelectImages(group, {i}), options);
  }
  std::vector<double> scales;
  for (int frame = 0; frame < static_cast<int>(group.frame_names.size()); ++frame) {
    const std::optional<double> scale = EstimateScale(group, individual, frame);
    if (!scale) return individual;
    scales.push_back(*scale);
  }
  for (QueryImage& image : group.images) image.cam_from_rig.translation *= scales[image.frame];
  Results results = LocalizeFrames(group, options);
  for (size_t i = 0; i < results.size(); ++i) {
    results[i].rig_scale *= scales[group.images[i].frame];
    results[i].seconds.insert(results[i].seconds.end(), individual[i].seconds.begin(), individual[i].seconds.end());
  }
  return results;
}

// Returns the images that are localized individually: lone images of unknown focal length, or all.
std::vector<int> IndividualImages(const QueryGroup& group, const LocalizerOptions& options) {
  std::map<int, int> num_images_of_frame;
  for (const QueryImage& image : group.images) ++num_images_of_frame[image.frame];
  std::vector<int> individual;
  for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
    const QueryImage& image = group.images[i];
    const bool is_lone = num_images_of_frame[image.frame] == 1;
    if (options.post_optimization != PostOptimization::TRACKS ||
        (is_lone && IsFocalLengthUnknown(image.problem, options))) {
      individual.push_back(i);
    }
  }
  return individual;
}

}  // namespace

std::vector<LocalizationResult> LocalizeGroup(const QueryGroup& group, const LocalizerOptions& options) {
  if (group.images.size() == 1) return {LocalizeLone(group, options)};
  const std::vector<int> individual = IndividualImages(group, options);
  if (individual.empty()) {
    return group.has_rig_scale ? LocalizeFrames(group, options) : LocalizeWithoutScale(group, options);
  }
  Results results(group.images.size());
  for (const int i : individual) results[i] = LocalizeLone(SelectImages(group, {i}), options);
  std::vector<bool> is_individual(group.images.size(), false);
  for (const int i : individual) is_individual[i] = true;
  std::vector<int> others;
  for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
    if (!is_individual[i]) others.push_back(i);
  }
  if (!others.empty()) Store(LocalizeGroup(SelectImages(group, others), options), others, &results);
  return results;
}

LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options) {
  QueryGroup group;
  group.frame_names = {""};
  group.images.push_back({problem, 0, {}});
  return std::move(LocalizeGroup(group, options).front());
}

}  // namespace lazyloc
