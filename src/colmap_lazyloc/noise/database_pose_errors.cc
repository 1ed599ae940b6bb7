#include "colmap_lazyloc/noise/database_pose_errors.h"

#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "colmap_lazyloc/bridge/observer.h"
#include "colmap_lazyloc/noise/database_priors.h"
#include "colmap_lazyloc/noise/epipolar_errors.h"
#include "colmap_lazyloc/noise/variance_estimate.h"

namespace lazyloc {
namespace {

// Expected error that changes with the viewpoint, and its minimum, in pixels.
constexpr double kViewpointNoisePx = 0.7, kMinViewpointNoisePx = 0.02;
// Expected and minimum independent error of a database pose, in pixels. It is estimated for rotations and positions
// apart, because for example GPS and an inertial sensor measure them by different means.
constexpr double kIndependentNoisePx = 0.05;
// Standard deviation of the log of an expected size: a factor of e, or of 1.35 for independent rotations. With a large
// size, all rotations would turn together where images of one camera have an error in common, but not the positions.
constexpr double kLogStddev = 1, kRotationLogStddev = 0.3;
// Standard deviations in pixels that the search for the estimate starts from. The likelihood can have two maxima,
// because either component may explain the same errors. The search starts from large independent errors, because if it
// started from small ones, the other component would explain them all.
constexpr double kFirstViewpointNoisePx = 0.1, kFirstIndependentNoisePx = 0.5;

// A database image and those of its neighbours whose matches tell their relative pose.
struct NeighbourFits {
  Rigid3d cam_from_world;
  std::vector<Rigid3d> others_from_world;
  std::vector<EpipolarFit> fits;  // by neighbour
};

// Returns the matches in the world's axes. observe, world_from_cam: of the database image.
std::vector<RayMatch> ObserveMatches(const Observer& observe, const Eigen::Matrix3d& world_from_cam,
                                     const NeighbourPair& pair, const Eigen::Matrix3d& world_from_other) {
  const Observer observe_other(pair.camera);
  std::vector<RayMatch> matches;
  for (size_t i = 0; i < pair.points.size(); ++i) {
    const std::optional<Observation> observation = observe(pair.points[i]), other = observe_other(pair.other_points[i]);
    if (observation && other) matches.push_back(MakeRayMatch(world_from_cam, *observation, world_from_other, *other));
  }
  return matches;
}

NeighbourFits FitNeighbours(const ImagePair& pair) {
  NeighbourFits neighbours{pair.database_cam_from_world, {}, {}};
  neighbours.cam_from_world.rotation.normalize();
  const Observer observe(pair.other_camera);
  const Eigen::Matrix3d world_from_cam = neighbours.cam_from_world.rotation.conjugate().toRotationMatrix();
  for (const NeighbourPair& neighbour : pair.neighbours) {
    Rigid3d other_from_world = neighbour.cam_from_world;
    other_from_world.rotation.normalize();
    const Eigen::Matrix3d world_from_other = other_from_world.rotation.conjugate().toRotationMatrix();
    const auto fit = FitEpipolarErrors(CamInWorld(other_from_world) - CamInWorld(neighbours.cam_from_world),
                                       ObserveMatches(observe, world_from_cam, neighbour, world_from_other));
    if (!fit) continue;
    neighbours.others_from_world.push_back(other_from_world);
    neighbours.fits.push_back(*fit);
  }
  return neighbours;
}

std::vector<NeighbourFits> FitNeighboursOfFrame(const QueryGroup& group, int frame) {
  std::vector<NeighbourFits> all;
  std::set<std::string> names;
  for (const QueryImage& query : group.images) {
    if (query.frame != frame) continue;
    for (const ImagePair& pair : query.problem.pairs) {
      if (pair.neighbours.empty() || !names.insert(pair.other_name).second) continue;
      NeighbourFits neighbours = FitNeighbours(pair);
      if (!neighbours.fits.empty()) all.push_back(std::move(neighbours));
    }
  }
  return all;
}

// Estimates the variances of the three components from all images with their neighbours. Each neighbour deviates from
// its image as database images deviate from a query, but for the independent error of the image, which all its
// neighbours have in common.
VarianceEstimate EstimateFromNeighbours(const std::vector<NeighbourFits>& all, Eigen::Index size,
                                        const std::vector<ExpectedStddev>& expected) {
  Eigen::MatrixXd viewpoint = Eigen::MatrixXd::Zero(size, size), independent = viewpoint;
  DeviationLikelihood likelihood{Eigen::MatrixXd::Zero(6 * size, 6 * size), Eigen::VectorXd::Zero(6 * size)};
  Eigen::Index begin = 0;
  for (const NeighbourFits& neighbours : all) {
    const auto num = static_cast<Eigen::Index>(neighbours.fits.size());
    double mean_distance = 0;
    for (Eigen::Index i = 0; i < num; ++i) {
      const EpipolarFit& fit = neighbours.fits[i];
      mean_distance += fit.scale.distance / static_cast<double>(num);
      const auto of_pair = Eigen::seqN(begin + i, 6, size);
      likelihood.information(of_pair, of_pair) = fit.information;
      likelihood.rhs(of_pair) = fit.rhs;
    }
    viewpoint.block(begin, begin, num, num) =
        ViewpointErrorShape(neighbours.others_from_world, neighbours.cam_from_world, mean_distance);
    independent.block(begin, begin, num, num).setOnes();
    begin += num;
  }
  independent.diagonal().array() += 1;
  PriorGroup group;
  group.frames.resize(size);
  group.components = {{viewpoint, 1}, {independent, 1, PosePart::ROTATION}, {independent, 1, PosePart::POSITION}};
  return EstimateVariances(group, likelihood, expected);
}

ExpectedPoseErrors MeasureFrame(const QueryGroup& group, int frame, ExpectedPoseErrors errors) {
  const std::vector<NeighbourFits> all = FitNeighboursOfFrame(group, frame);
  for (const NeighbourFits& neighbours : all) errors.num_pairs += static_cast<int>(neighbours.fits.size());
  if (errors.num_pairs == 0) return errors;
  errors.source = PoseNoiseSource::DATABASE_PAIRS;
  std::vector<ExpectedStddev> expected = errors.sizes;
  // Lets rotations be as large as they are, because relative poses tell errors of intrinsics from those of rotations.
  expected[1].log_stddev = kLogStddev;
  const std::vector<double> variances = EstimateFromNeighbours(all, errors.num_pairs, expected).variances;
  for (size_t j = 0; j < variances.size(); ++j) errors.sizes[j].median = std::sqrt(variances[j]);
  return errors;
}

}  // namespace

ExpectedPoseErrors ExpectPoseErrors(const LocalizerOptions& options) {
  if (options.database_pose_stddev_deg >= 0 || options.database_pose_stddev_length >= 0) {
    return {{}, PoseNoiseSource::STATED};
  }
  return {{{kViewpointNoisePx, kLogStddev, kMinViewpointNoisePx, kFirstViewpointNoisePx},
           {kIndependentNoisePx, kRotationLogStddev, kIndependentNoisePx, kFirstIndependentNoisePx},
           {kIndependentNoisePx, kLogStddev, kIndependentNoisePx, kFirstIndependentNoisePx}},
          PoseNoiseSource::DEFAULT};
}

std::vector<ExpectedPoseErrors> MeasurePoseErrors(const QueryGroup& group, const LocalizerOptions& options) {
  const ExpectedPoseErrors expected = ExpectPoseErrors(options);
  std::vector<ExpectedPoseErrors> errors(group.frame_names.size(), expected);
  if (expected.source == PoseNoiseSource::STATED) return errors;
  for (size_t frame = 0; frame < errors.size(); ++frame) {
    errors[frame] = MeasureFrame(group, static_cast<int>(frame), expected);
  }
  return errors;
}

}  // namespace lazyloc
