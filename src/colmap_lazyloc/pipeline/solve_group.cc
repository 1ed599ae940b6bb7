#include "colmap_lazyloc/pipeline/solve_group.h"

#include <algorithm>
#include <list>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include "colmap_lazyloc/group/group_partition.h"
#include "colmap_lazyloc/intrinsics/focal_length.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/pipeline/prepare.h"

namespace lazyloc {
namespace {

// Returns the numbers from 0 to num - 1.
std::vector<int> Indices(size_t num) {
  std::vector<int> indices(num);
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

// Images that are solved together, the hypotheses that were tried, and the choice among their solutions.
struct Together {
  // whole: outlives this; null if the images are a group of their own.
  Together(const QueryGroup* whole, QueryGroup own) : own_group(std::move(own)), group(whole ? *whole : own_group) {}

  const QueryGroup own_group;
  const QueryGroup& group;
  Preparations preparations{group};
  std::list<Solution> solutions;
  Choice choice;
};

// Returns the scale of a frame from the poses of its images when each is solved individually: the median over pairs of
// images of the ratio of their distances; nullopt if no two images with different places have a pose.
std::optional<double> EstimateScale(const QueryGroup& group, const std::vector<ImageChoice>& individual, int frame,
                                    const LocalizerOptions& options) {
  std::vector<double> ratios;
  const auto distance = [](const Rigid3d& a, const Rigid3d& b) { return (CamInWorld(a) - CamInWorld(b)).norm(); };
  const auto pose = [&](size_t i) {
    const Solution& solution = *individual[i].choice->solution;
    return PoseInWorld(solution.prepared->layout, solution.checked.posed, 0);
  };
  const auto is_used = [&](size_t i) {
    return group.images[i].frame == frame && FramesWithoutPose(*individual[i].choice, options).empty();
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

// Returns true if an image is solved individually: all are by the paper's method, single images of unknown focal length
// too.
bool IsIndividual(const QueryGroup& group, size_t i, const LocalizerOptions& options) {
  const std::vector<QueryImage>& images = group.images;  // in ascending order of their frames
  const bool is_single = (i == 0 || images[i - 1].frame != images[i].frame) &&
                         (i + 1 == images.size() || images[i + 1].frame != images[i].frame);
  return options.method == Method::PAPER || (is_single && IsFocalLengthUnknown(images[i].problem, options));
}

// Solves a group and the parts that it falls into.
class GroupSolver {
 public:
  GroupSolver(const QueryGroup& group, const LocalizerOptions& options)
      : group_(group), options_(options), chosen_(group.images.size()) {}

  std::vector<ImageChoice> Solve() {
    if (group_.images.empty()) return {};
    const std::vector<int> all = Indices(group_.images.size());
    std::vector<int> individual, others;
    for (const int i : all) {
      (all.size() > 1 && IsIndividual(group_, i, options_) ? individual : others).push_back(i);
    }
    for (const int i : individual) SolveTogether(group_, {i}, all);
    if (!others.empty()) SolveOthers(others);
    return std::move(chosen_);
  }

 private:
  // Solves images that are not individual from the beginning.
  void SolveOthers(const std::vector<int>& images) {
    const bool is_part = images.size() < group_.images.size();
    const QueryGroup part = is_part ? SelectImages(group_, images) : QueryGroup();
    const QueryGroup& group = is_part ? part : group_;
    if (images.size() == 1 || group.has_rig_scale) {
      SolveFrames(group, images);
    } else {
      SolveWithoutScale(group, images);
    }
  }

  // Solves some images of a group in one, under each hypothesis that the solutions so far leave room for, and chooses.
  // The choice replaces earlier ones for these images. of_all: the images' indices among those of group_. Returns the
  // frames without a pose; all frames if the failure is one of the whole group.
  std::vector<int> SolveTogether(const QueryGroup& group, const std::vector<int>& images,
                                 const std::vector<int>& of_all) {
    QueryGroup own;
    const bool are_all = images.size() == group.images.size(), are_whole_group = are_all && &group == &group_;
    if (!are_whole_group) own = are_all ? group : SelectImages(group, images);
    const auto together = std::make_shared<Together>(are_whole_group ? &group_ : nullptr, std::move(own));
    StageTimer::Seconds seconds;
    Choices choices;
    while (const std::optional<Hypothesis> hypothesis = NextHypothesis(together->group, choices, options_)) {
      const Prepared& prepared = together->preparations.For(*hypothesis, options_, &known_, &seconds);
      const Choice* given = choices.given ? &*choices.given : nullptr;
      choices.Add(together->solutions.emplace_back(lazyloc::Solve(prepared, *hypothesis, given, options_, &seconds)));
    }
    together->choice = Choose(choices, options_);
    for (size_t query = 0; query < images.size(); ++query) {
      ImageChoice& chosen = chosen_[of_all[images[query]]];
      chosen.choice = std::shared_ptr<const Choice>(together, &together->choice);
      chosen.query = static_cast<int>(query);
      for (const auto& [stage, elapsed] : seconds) {
        StageTimer::Add(stage, elapsed / static_cast<double>(images.size()), &chosen.seconds);
      }
    }
    return FramesWithoutPose(together->choice, options_);
  }

  // Solves the frames of a group together; those that fail leave it, one by one, and are solved individually.
  void SolveFrames(const QueryGroup& group, const std::vector<int>& of_all) {
    std::vector<int> frames = Indices(group.frame_names.size());  // those that are still together
    while (!frames.empty()) {
      const std::vector<int> lost = SolveTogether(group, ImagesOfFrames(group, frames), of_all);
      if (lost.empty() || frames.size() == 1) return;
      std::vector<int> others;
      for (int i = 0; i < static_cast<int>(frames.size()); ++i) {
        if (std::count(lost.begin(), lost.end(), i) == 0) {
          others.push_back(frames[i]);
        } else {
          SolveTogether(group, ImagesOfFrames(group, {frames[i]}), of_all);
        }
      }
      frames = std::move(others);
    }
  }

  // Solves frames whose translations have no scale. Starts from the scale that the images give individually; if they
  // give none, these solutions are left.
  void SolveWithoutScale(QueryGroup group, const std::vector<int>& of_all) {
    std::vector<ImageChoice> individual;
    for (int i = 0; i < static_cast<int>(group.images.size()); ++i) {
      SolveTogether(group, {i}, of_all);
      individual.push_back(chosen_[of_all[i]]);
    }
    std::vector<double> scales;
    for (int frame = 0; frame < static_cast<int>(group.frame_names.size()); ++frame) {
      const std::optional<double> scale = EstimateScale(group, individual, frame, options_);
      if (!scale) return;
      scales.push_back(*scale);
    }
    for (QueryImage& image : group.images) {
      image.rig_scale = scales[image.frame];
      image.cam_from_rig.translation *= image.rig_scale;
    }
    SolveFrames(group, of_all);
  }

  const QueryGroup& group_;
  const LocalizerOptions& options_;
  KnownRelativePoses known_;
  std::vector<ImageChoice> chosen_;  // by image of group_
};

}  // namespace

std::vector<ImageChoice> SolveGroup(const QueryGroup& group, const LocalizerOptions& options) {
  return GroupSolver(group, options).Solve();
}

}  // namespace lazyloc
