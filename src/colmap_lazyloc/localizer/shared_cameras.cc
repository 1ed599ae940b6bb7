#include "colmap_lazyloc/localizer/shared_cameras.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/group/uncalibrated_camera.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/pipeline/solve_group.h"

namespace lazyloc {
namespace {

// Maximum difference of a query's own focal length from the median, in its standard deviations and in its log.
constexpr double kMaxFocalSigma = 5;
constexpr double kMinFocalDifference = 0.01;
// Number of steps at most, and displacement of the image's corners up to which the intrinsics have settled.
constexpr int kMaxNumSteps = 8;
constexpr double kMaxCornerChangePx = 0.05;

using Queries = std::vector<const CalibrationQuery*>;

const LocalizationProblem& ProblemOf(const CalibrationQuery& query) { return query.group.images.front().problem; }

// Returns the queries by given camera.
std::vector<Queries> ByGivenCamera(const std::vector<CalibrationQuery>& queries) {
  std::vector<Queries> sets;
  for (const CalibrationQuery& query : queries) {
    const auto set = std::find_if(sets.begin(), sets.end(), [&](const Queries& other) {
      return SameIntrinsics(ProblemOf(*other.front()).query_camera, ProblemOf(query).query_camera);
    });
    (set == sets.end() ? sets.emplace_back() : *set).push_back(&query);
  }
  return sets;
}

Queries WithoutOtherZooms(Queries queries) {
  std::vector<double> log_factors;
  for (const CalibrationQuery* query : queries) log_factors.push_back(query->log_focal_factor);
  const double median = Median(std::move(log_factors));
  const auto is_other = [&](const CalibrationQuery* query) {
    return std::abs(query->log_focal_factor - median) >
           std::max(kMaxFocalSigma * query->log_focal_stddev, kMinFocalDifference);
  };
  queries.erase(std::remove_if(queries.begin(), queries.end(), is_other), queries.end());
  return queries;
}

// Localizes a query with a camera. Returns what its matches say of corrections of the camera; nullopt without a pose.
std::optional<IntrinsicsInformation> InformationWith(const Camera& camera, const CalibrationQuery& query,
                                                     LocalizerOptions options) {
  QueryGroup group = query.group;
  group.images.front().problem.query_camera = camera;
  group.images.front().problem.intrinsics_origin = IntrinsicsOrigin::JOINT;
  options.intrinsics = IntrinsicsMode::GIVEN;
  const std::vector<ImageChoice> choices = SolveGroup(group, options);
  const Choice& choice = *choices.front().choice;
  if (RefusalOf(choice, 0, options) || choice.solution->checked.information.empty()) return std::nullopt;
  return choice.solution->checked.information.front();
}

std::optional<SharedCamera> EstimateSharedCamera(const Queries& queries, const LocalizerOptions& options,
                                                 IdleThreads* idle_threads) {
  const LocalizationProblem& first = ProblemOf(*queries.front());
  const Camera given = WithAllCorrections(first.query_camera);
  const CalibrationQuery& best = **std::min_element(
      queries.begin(), queries.end(),
      [](const CalibrationQuery* a, const CalibrationQuery* b) { return a->log_focal_stddev < b->log_focal_stddev; });
  SharedCamera shared{first.query_camera, WithAllCorrections(best.estimate)};
  for (int step = 0; step < kMaxNumSteps; ++step) {
    std::vector<std::optional<IntrinsicsInformation>> of_queries(queries.size());
    ParallelFor(
        queries.size(), [&](size_t i) { of_queries[i] = InformationWith(shared.camera, *queries[i], options); },
        idle_threads);
    const IntrinsicsCorrections made = CorrectionsBetween(given, shared.camera);
    IntrinsicsInformation sum;
    shared.num_queries = 0;
    for (const std::optional<IntrinsicsInformation>& information : of_queries) {
      if (!information) continue;
      sum.precision += information->precision;
      sum.gradient += information->precision * made + information->gradient;
      ++shared.num_queries;
    }
    if (shared.num_queries < 2) return std::nullopt;
    const IntrinsicsDistribution joint = JointCorrections(sum, given, first.intrinsics_origin);
    shared.camera = Corrected(given, joint.mean);
    const IntrinsicsCorrections change = CorrectionsBetween(given, shared.camera) - made;
    // Takes the expected square of what the camera's model cannot correct.
    const IntrinsicsCorrections left = joint.mean - CorrectionsBetween(given, shared.camera);
    shared.covariance = joint.covariance + left * left.transpose();
    if (CornerDisplacementPx(change, given) <= kMaxCornerChangePx) break;
  }
  return shared;
}

}  // namespace

SharedCameras EstimateSharedCameras(const std::vector<CalibrationQuery>& queries, const LocalizerOptions& options,
                                    IdleThreads* idle_threads) {
  SharedCameras cameras;
  for (Queries& set : ByGivenCamera(queries)) {
    set = WithoutOtherZooms(std::move(set));
    if (set.size() < 2) continue;
    std::optional<SharedCamera> shared = EstimateSharedCamera(set, options, idle_threads);
    if (shared) cameras.push_back(*std::move(shared));
  }
  return cameras;
}

}  // namespace lazyloc
