#include "colmap_lazyloc/pipeline/lazy_localizer.h"

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "colmap_lazyloc/group/group_partition.h"
#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/pipeline/choose.h"
#include "colmap_lazyloc/pipeline/make_result.h"

namespace lazyloc {
namespace {

using Results = std::vector<LocalizationResult>;

// Returns the numbers from 0 to num - 1.
std::vector<int> Indices(size_t num) {
  std::vector<int> indices(num);
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

struct Answer {
  Results results;                       // by image of the group
  std::vector<int> frames_without_pose;  // all frames if the failure is one of the whole group
};

// Moves the results of some images to their places among those of all, and adds the seconds that these had spent.
void Store(Results results, const std::vector<int>& images, Results* all) {
  for (size_t i = 0; i < images.size(); ++i) {
    LocalizationResult& stored = (*all)[images[i]];
    StageTimer::Seconds seconds = std::move(stored.seconds);
    for (const auto& [stage, elapsed] : results[i].seconds) StageTimer::Add(stage, elapsed, &seconds);
    stored = std::move(results[i]);
    stored.seconds = std::move(seconds);
  }
}

// Returns the scale of a frame from the poses of its images when each is localized individually: the median over pairs
// of images of the ratio of their distances; nullopt if no two images with different places have a pose.
std::optional<double> EstimateScale(const QueryGroup& group, const std::vector<Answer>& individual, int frame) {
  std::vector<double> ratios;
  const auto distance = [](const Rigid3d& a, const Rigid3d& b) { return (CamInWorld(a) - CamInWorld(b)).norm(); };
  const auto pose = [&](size_t i) { return individual[i].results.front().cam_from_world; };
  const auto is_used = [&](size_t i) {
    return group.images[i].frame == frame && individual[i].frames_without_pose.empty();
  };
  for (size_t i = 0; i < individual.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (!is_used(i) || !is_used(j)) continue;
      const double given = distance(group.images[i].cam_from_rig, group.images[j].cam_from_rig);
      if (given > 0) ratios.push_back(distance(pose(i), pose(j)) / given);
    }
  }
  if (ratios.empty()) return std::nullopt;
  const double scale = Median(std::move(ratios));
  return scale > 0 ? std::make_optional(scale) : std::nullopt;
}

// Returns true if an image is localized individually: all are by the paper's method, single images of unknown
// focal length too.
bool IsIndividual(const QueryGroup& group, size_t i, const LocalizerOptions& options) {
  const std::vector<QueryImage>& images = group.images;  // in ascending order of their frames
  const bool is_single = (i == 0 || images[i - 1].frame != images[i].frame) &&
                         (i + 1 == images.size() || images[i + 1].frame != images[i].frame);
  return options.method == Method::PAPER || (is_single && IsFocalLengthUnknown(images[i].problem, options));
}

// Localizes a group and the parts that it falls into.
class GroupLocalizer {
 public:
  explicit GroupLocalizer(const LocalizerOptions& options) : options_(options) {}

  Results Localize(const QueryGroup& group) {
    if (group.images.size() == 1) return LocalizeTogether(group).results;
    std::vector<int> individual, others;
    for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
      (IsIndividual(group, i, options_) ? individual : others).push_back(i);
    }
    if (individual.empty()) return group.has_rig_scale ? LocalizeFrames(group) : LocalizeWithoutScale(group);
    Results results(group.images.size());
    for (const int i : individual) Store(LocalizeTogether(SelectImages(group, {i})).results, {i}, &results);
    if (!others.empty()) Store(Localize(SelectImages(group, others)), others, &results);
    return results;
  }

 private:
  // Solves all frames of a group in one, under each hypothesis that the solutions so far leave room for, and chooses.
  Answer LocalizeTogether(const QueryGroup& group) {
    StageTimer::Seconds seconds;
    Preparations preparations(group, options_, &known_, &seconds);
    std::vector<Solution> solutions;
    while (const std::optional<Hypothesis> hypothesis = NextHypothesis(group, solutions, options_)) {
      solutions.push_back(Solve(preparations.For(*hypothesis), *hypothesis, options_, &seconds));
    }
    const Choice choice = Choose(solutions, options_);
    return {MakeResults(choice, options_, seconds), FramesWithoutPose(choice, options_)};
  }

  // Localizes the frames together; those that fail leave the group, one by one, and are localized individually.
  Results LocalizeFrames(const QueryGroup& group) {
    Results results(group.images.size());
    std::vector<int> frames = Indices(group.frame_names.size());  // those that are still together
    QueryGroup rest;
    for (const QueryGroup* together = &group;; together = &rest) {
      Answer answer = LocalizeTogether(*together);
      Store(std::move(answer.results), ImagesOfFrames(group, frames), &results);
      const std::vector<int>& lost = answer.frames_without_pose;
      if (lost.empty() || frames.size() == 1) return results;
      for (const int lost_frame : lost) {
        const std::vector<int> images = ImagesOfFrames(group, {frames[lost_frame]});
        Store(LocalizeTogether(SelectImages(group, images)).results, images, &results);
      }
      std::vector<int> others;
      for (int i = 0; i < static_cast<int>(frames.size()); ++i) {
        if (std::count(lost.begin(), lost.end(), i) == 0) others.push_back(frames[i]);
      }
      if (others.empty()) return results;
      frames = std::move(others);
      rest = SelectImages(group, ImagesOfFrames(group, frames));
    }
  }

  // Localizes frames whose translations have no scale. Starts from the scale that the images give individually; if they
  // give none, their own results are returned.
  Results LocalizeWithoutScale(QueryGroup group) {
    Results results(group.images.size());
    std::vector<Answer> individual;
    for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
      individual.push_back(LocalizeTogether(SelectImages(group, {i})));
      Store(individual.back().results, {i}, &results);
    }
    std::vector<double> scales;
    for (int frame = 0; frame < static_cast<int>(group.frame_names.size()); ++frame) {
      const std::optional<double> scale = EstimateScale(group, individual, frame);
      if (!scale) return results;
      scales.push_back(*scale);
    }
    for (QueryImage& image : group.images) image.cam_from_rig.translation *= scales[image.frame];
    Store(LocalizeFrames(group), Indices(group.images.size()), &results);
    for (size_t i = 0; i < results.size(); ++i) results[i].rig_scale *= scales[group.images[i].frame];
    return results;
  }

  const LocalizerOptions& options_;
  KnownRelativePoses known_;
};

}  // namespace

std::vector<LocalizationResult> LocalizeGroup(const QueryGroup& group, const LocalizerOptions& options) {
  return GroupLocalizer(options).Localize(group);
}

LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options) {
  QueryGroup group;
  group.frame_names = {""};
  group.images.push_back({problem, 0, {}});
  return std::move(LocalizeGroup(group, options).front());
}

}  // namespace lazyloc
