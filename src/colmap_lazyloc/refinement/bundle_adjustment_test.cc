#include "colmap_lazyloc/refinement/bundle_adjustment.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

// Disturbs the poses of query frames, and the points.
void Disturb(SyntheticTracks* scene, double rotation_deg, double translation, double point) {
  Random random(17);
  for (Frame& frame : scene->posed.frames) {
    if (frame.is_database) continue;
    frame.frame_from_world.rotation = Disturbed(frame.frame_from_world.rotation, rotation_deg, &random);
    frame.frame_from_world.translation += translation * RandomVector(&random);
  }
  for (Track& track : scene->tracks) track.point_in_world += point * RandomVector(&random);
}

// Gives `image` the frame of `first`, which must come before it. Both keep their poses.
void JoinFrame(int first, int image, PosedImages* posed) {
  Image& joined = posed->images[image];
  const int removed = joined.frame;
  joined.cam_from_frame = CamFromWorld(*posed, image) * Inverse(posed->FrameOf(first).frame_from_world);
  joined.frame = posed->images[first].frame;
  posed->frames.erase(posed->frames.begin() + removed);
  for (Image& other : posed->images) other.frame -= other.frame > removed;
}

// Moves a database frame away from its pose, and gives it a prior that allows for that.
void DisturbWithPrior(int frame, PosedImages* posed) {
  Random random(frame);
  Rigid3d& pose = posed->frames[frame].frame_from_world;
  pose = CamFromWorld(Disturbed(pose.rotation, 0.5, &random), CamInWorld(pose) + 0.05 * RandomVector(&random));
  posed->frames[frame].prior = PosePrior{pose, DegToRad(0.5), 0.05};
}

void ExpectSameBits(const Rigid3d& a, const Rigid3d& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.translation, b.translation);
}

// Computes the residual of AdjustBundle for Ceres' automatic derivatives. Parameters: angle-axis and translation of
// frame_from_world, log of the focal factor or of the frame's scale, point.
struct ReferenceCost {
  Observation observation;
  Image image;
  bool has_free_scale;
  template <typename T>
  bool operator()(const T* angle_axis, const T* translation, const T* log_factor, const T* point, T* residual) const {
    const Eigen::Matrix3d rotation = image.cam_from_frame.rotation.toRotationMatrix();
    const T scale = has_free_scale ? T(ceres::exp(*log_factor)) : T(1);
    T rotated[3];
    ceres::AngleAxisRotatePoint(angle_axis, point, rotated);
    T depth(0);
    residual[0] = residual[1] = T(0);
    for (int i = 0; i < 3; ++i) {
      T coordinate = scale * image.cam_from_frame.translation(i);
      for (int j = 0; j < 3; ++j) coordinate += rotation(i, j) * (rotated[j] + translation[j]);
      depth += observation.ray_in_cam(i) * coordinate;
      for (int row = 0; row < 2; ++row) residual[row] += observation.px_from_cam(row, i) * coordinate;
    }
    const T log_focal_factor = has_free_scale ? T(0) : *log_factor;
    for (int row = 0; row < 2; ++row) {
      residual[row] = (residual[row] / depth + log_focal_factor * observation.px_from_log_focal[row]) / image.noise_px;
    }
    return true;
  }
};

// Computes the deviation of frame_from_world from its prior.
struct ReferencePrior {
  PosePrior prior;
  template <typename T>
  bool operator()(const T* angle_axis, const T* translation, T* residual) const {
    const Eigen::Quaterniond inverse = prior.frame_from_world.rotation.conjugate();
    const T inverse_prior[4] = {T(inverse.w()), T(inverse.x()), T(inverse.y()), T(inverse.z())};
    T rotation[4], deviation[4];
    ceres::AngleAxisToQuaternion(angle_axis, rotation);
    ceres::QuaternionProduct(rotation, inverse_prior, deviation);
    ceres::QuaternionToAngleAxis(deviation, residual);
    const T inverse_angle_axis[3] = {-angle_axis[0], -angle_axis[1], -angle_axis[2]};
    T minus_centre[3];
    ceres::AngleAxisRotatePoint(inverse_angle_axis, translation, minus_centre);
    for (int i = 0; i < 3; ++i) {
      residual[i] /= prior.rotation_stddev_rad;
      residual[3 + i] = (-minus_centre[i] - CamInWorld(prior.frame_from_world)(i)) / prior.position_stddev;
    }
    return true;
  }
};

using FrameParameters = Eigen::Matrix<double, 7, 1>;  // angle-axis, translation, log factor

PosedImages MovedTo(const std::vector<FrameParameters>& parameters, PosedImages posed) {
  for (size_t i = 0; i < parameters.size(); ++i) {
    Frame& frame = posed.frames[i];
    frame.frame_from_world = {ExpSO3(parameters[i].head<3>()), parameters[i].segment<3>(3)};
    if (frame.has_free_scale) frame.scale *= std::exp(parameters[i][6]);
  }
  for (Image& image : posed.images) {
    const double log_factor = parameters[image.frame][6];
    if (posed.frames[image.frame].has_free_scale) image.cam_from_frame.translation *= std::exp(log_factor);
    if (image.log_focal_factor) image.log_focal_factor = log_factor;
  }
  return posed;
}

PosedImages SolveWithCeres(SyntheticTracks scene, const BundleAdjustmentOptions& options) {
  std::vector<FrameParameters> parameters;
  ceres::Problem problem;
  for (const Frame& frame : scene.posed.frames) {
    parameters.emplace_back() << LogSO3(frame.frame_from_world.rotation), frame.frame_from_world.translation, 0;
  }
  for (size_t i = 0; i < parameters.size(); ++i) {
    double* pose = parameters[i].data();
    problem.AddParameterBlock(pose, 3);
    problem.AddParameterBlock(pose + 3, 3);
    problem.AddParameterBlock(pose + 6, 1);
    const Frame& frame = scene.posed.frames[i];
    if (!frame.has_free_scale) problem.SetParameterBlockConstant(pose + 6);
    if (frame.prior) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<ReferencePrior, 6, 3, 3>(new ReferencePrior{*frame.prior}), nullptr, pose,
          pose + 3);
    }
    if (!IsConstant(frame)) continue;
    problem.SetParameterBlockConstant(pose);
    problem.SetParameterBlockConstant(pose + 3);
  }
  for (const Image& image : scene.posed.images) {
    if (image.log_focal_factor) problem.SetParameterBlockVariable(parameters[image.frame].data() + 6);
  }
  for (Track& track : scene.tracks) {
    for (const TrackObservation& element : track.observations) {
      const Image& image = scene.posed.images[element.image];
      double* pose = parameters[image.frame].data();
      const bool has_free_scale = scene.posed.FrameOf(element.image).has_free_scale;
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<ReferenceCost, 2, 3, 3, 1, 3>(
                                   new ReferenceCost{element.observation, image, has_free_scale}),
                               new ceres::CauchyLoss(options.loss_scale_sigma), pose, pose + 3, pose + 6,
                               track.point_in_world.data());
    }
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = ceres::DENSE_SCHUR;
  solver_options.max_num_iterations = 200;
  solver_options.function_tolerance = solver_options.parameter_tolerance = solver_options.gradient_tolerance = 1e-15;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  return MovedTo(parameters, scene.posed);
}

// Returns options for which the result differs from the minimum by rounding errors only.
BundleAdjustmentOptions Precise() {
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-9;
  options.max_num_iterations = 500;
  return options;
}

// Estimates the focal lengths of all queries but the last of several. Rotates their rays towards the optical axis, as a
// focal length that is too long does, and sets the derivative by its log such that log_focal_factor undoes exactly
// this.
void DisturbFocalLengths(double log_focal_factor, int num_query, SyntheticTracks* scene) {
  const int num_estimated = std::max(1, num_query - 1);
  for (int query = 0; query < num_estimated; ++query) scene->posed.images[query].log_focal_factor = 0;
  for (Track& track : scene->tracks) {
    for (TrackObservation& element : track.observations) {
      if (element.image >= num_estimated) continue;
      Observation& observation = element.observation;
      const Eigen::Vector3d point_in_cam = CamFromWorld(scene->posed, element.image) * track.point_in_world;
      const Eigen::Vector2d noise_px = ReprojectionError(observation, point_in_cam);
      observation.ray_in_cam.head<2>() *= std::exp(-log_focal_factor);
      observation.ray_in_cam.normalize();
      observation.px_from_cam -= observation.px_from_cam * observation.ray_in_cam * observation.ray_in_cam.transpose();
      observation.px_from_log_focal = (noise_px - ReprojectionError(observation, point_in_cam)) / log_focal_factor;
    }
  }
}

class QueryCounts : public testing::TestWithParam<int> {
 protected:
  SyntheticTracks Make(double noise_px) const {
    SyntheticTracksOptions options;
    options.num_query = GetParam();
    options.noise_px = noise_px;
    options.min_images_ratio = 0.5;
    return MakeSyntheticTracks(options);
  }
};

TEST_P(QueryCounts, NoiseFreeIsExact) {
  const SyntheticTracks truth = Make(0);
  SyntheticTracks scene = truth;
  Disturb(&scene, 2, 0.2, 0.1);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (int query = 0; query < GetParam(); ++query) {
    const Rigid3d adjusted = CamFromWorld(result.posed, query), exact = CamFromWorld(truth.posed, query);
    EXPECT_LE(PositionError(adjusted, exact), 1e-8 * 8);
    EXPECT_LE(RotationErrorDeg(adjusted, exact), RadToDeg(1e-8));
  }
  ASSERT_EQ(result.tracks.size(), truth.tracks.size());
  for (size_t i = 0; i < truth.tracks.size(); ++i) {
    EXPECT_LE((result.tracks[i].point_in_world - truth.tracks[i].point_in_world).norm(), 1e-7);
  }
}

TEST_P(QueryCounts, FocalLengthIsFoundExactlyWithoutNoise) {
  SyntheticTracks scene = Make(0);
  DisturbFocalLengths(0.1, GetParam(), &scene);
  const SyntheticTracks truth = scene;
  Disturb(&scene, 2, 0.2, 0.1);
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-6;
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, options);
  ASSERT_TRUE(result.summary.success);
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(truth.posed, query)), 1e-7);
    const std::optional<double>& log_focal_factor = result.posed.images[query].log_focal_factor;
    const bool is_estimated = query == 0 || query < GetParam() - 1;
    ASSERT_EQ(log_focal_factor.has_value(), is_estimated);
    EXPECT_NEAR(log_focal_factor.value_or(0), is_estimated ? 0.1 : 0, 1e-8);
  }
  // Starts at the factor of the input: the first step from the solution is the last.
  const BundleAdjustmentResult again = AdjustBundle(result.posed, result.tracks, {});
  EXPECT_EQ(again.summary.iterations, 0);
  EXPECT_NEAR(*again.posed.images[0].log_focal_factor, 0.1, 1e-8);
}

TEST_P(QueryCounts, FreeFocalLengthAgreesWithCeres) {
  SyntheticTracks scene = Make(1.5);
  DisturbFocalLengths(0.1, GetParam(), &scene);
  Disturb(&scene, 1, 0.1, 0.05);
  const PosedImages reference = SolveWithCeres(scene, Precise());
  BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, Precise());
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(reference, query)), 1e-5);
    const std::optional<double>& log_focal_factor = result.posed.images[query].log_focal_factor;
    if (!log_focal_factor) continue;
    EXPECT_NEAR(*log_focal_factor, *reference.images[query].log_focal_factor, 1e-6);
    EXPECT_GT(std::abs(*log_focal_factor - 0.1), 1e-5) << "the noise has no effect";
  }
  // Expects a larger covariance, because the focal length is unknown.
  for (Image& image : result.posed.images) image.log_focal_factor.reset();
  EXPECT_GT(result.image_covariances[0].trace(),
            AdjustBundle(result.posed, result.tracks, Precise()).image_covariances[0].trace());
}

TEST_P(QueryCounts, AgreesWithCeres) {
  SyntheticTracks scene = Make(1.5);
  scene.posed.images.back().noise_px = 3;
  Random random(5);
  for (int i = 0; i < 5; ++i) {  // adds gross outliers
    TrackObservation& element = scene.tracks[i].observations.back();
    element.observation = ObserveAt(CamFromWorld(scene.posed, element.image) * scene.tracks[i].point_in_world, 500,
                                    30 * RandomVector(&random).head<2>());
  }
  Disturb(&scene, 1, 0.1, 0.05);
  const PosedImages reference = SolveWithCeres(scene, Precise());
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, Precise());
  ASSERT_TRUE(result.summary.success);
  for (int query = 0; query < GetParam(); ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(reference, query)), 1e-5);
    EXPECT_LE(RotationErrorDeg(CamFromWorld(result.posed, query), CamFromWorld(reference, query)), 1e-4);
  }
}

TEST_P(QueryCounts, KeepsConstantFramesBitwise) {
  SyntheticTracks scene = Make(1);
  const PosedImages before = scene.posed;
  Disturb(&scene, 1, 0.1, 0.1);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  for (size_t i = 0; i < before.frames.size(); ++i) {
    if (!before.frames[i].is_database) continue;
    ExpectSameBits(result.posed.frames[i].frame_from_world, before.frames[i].frame_from_world);
    EXPECT_TRUE(result.frame_covariances[i].isZero(0));
    EXPECT_TRUE(result.image_covariances[i].isZero(0));
  }
}

INSTANTIATE_TEST_SUITE_P(BundleAdjustment, QueryCounts, testing::Values(1, 3));

TEST(BundleAdjustment, PointBehindACameraFailsAndChangesNothing) {
  SyntheticTracks scene = MakeSyntheticTracks({});
  Disturb(&scene, 1, 0.1, 0.1);
  scene.tracks[0].point_in_world = Eigen::Vector3d(0, 0, -1000);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  EXPECT_FALSE(result.summary.success);
  ExpectSameBits(CamFromWorld(result.posed, 0), CamFromWorld(scene.posed, 0));
  ASSERT_EQ(result.tracks.size(), scene.tracks.size());
  EXPECT_EQ(result.tracks[1].point_in_world, scene.tracks[1].point_in_world);
  EXPECT_TRUE(result.frame_covariances.empty());
  EXPECT_TRUE(result.image_covariances.empty());
}

// Holds the two database images of a frame.
struct SharedFrame {
  int first, second;
};
class SharedDatabaseFrames : public testing::TestWithParam<SharedFrame> {
 protected:
  SyntheticTracks MakeTruth(double noise_px) const {
    SyntheticTracksOptions options;
    options.noise_px = noise_px;
    SyntheticTracks scene = MakeSyntheticTracks(options);
    JoinFrame(GetParam().first, GetParam().second, &scene.posed);
    return scene;
  }
};

TEST_P(SharedDatabaseFrames, MoveAsOneToTheTruth) {
  // Leaves two tracks to the second image: too few for a pose of its own.
  SyntheticTracks truth = MakeTruth(0);
  const int second = GetParam().second;
  for (size_t i = 2; i < truth.tracks.size(); ++i) {
    std::vector<TrackObservation>& observations = truth.tracks[i].observations;
    observations.erase(observations.begin() + second);
  }
  for (Image& image : truth.posed.images) image.noise_px = 1e-3;
  SyntheticTracks scene = truth;
  const int shared = scene.posed.images[second].frame;
  DisturbWithPrior(shared, &scene.posed);
  Disturb(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (const int image : {0, GetParam().first, second}) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, image), CamFromWorld(truth.posed, image)), 1e-4) << image;
    EXPECT_LE(RotationErrorDeg(CamFromWorld(result.posed, image), CamFromWorld(truth.posed, image)), 1e-3) << image;
    ExpectSameBits(result.posed.images[image].cam_from_frame, scene.posed.images[image].cam_from_frame);
  }
  EXPECT_EQ(result.prior_fit.num_parameters, 6) << "one prior for both images";
  EXPECT_EQ(result.image_covariances[GetParam().first], result.frame_covariances[shared]);
  EXPECT_EQ(result.image_covariances[second],
            ImageCovariance(result.posed.images[second], false, result.frame_covariances[shared]));
}

TEST_P(SharedDatabaseFrames, AgreeWithCeres) {
  SyntheticTracks scene = MakeTruth(1.5);
  for (int frame = 1; frame < 4; ++frame) DisturbWithPrior(frame, &scene.posed);
  Disturb(&scene, 1, 0.1, 0.05);
  const PosedImages reference = SolveWithCeres(scene, Precise());
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, Precise());
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  for (int image = 0; image < 7; ++image) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, image), CamFromWorld(reference, image)), 1e-4) << image;
    EXPECT_LE(RotationErrorDeg(CamFromWorld(result.posed, image), CamFromWorld(reference, image)), 1e-3) << image;
  }
}

TEST_P(SharedDatabaseFrames, WithoutPriorAreConstantBitwise) {
  SyntheticTracks scene = MakeTruth(1);
  Disturb(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  for (int image = 1; image < 7; ++image) {
    ExpectSameBits(CamFromWorld(result.posed, image), CamFromWorld(scene.posed, image));
    EXPECT_TRUE(result.image_covariances[image].isZero(0));
  }
}

// Moves the second image next to the first.
SyntheticTracks WithImagesTogether(SyntheticTracks scene, const SharedFrame& shared) {
  std::vector<Image>& images = scene.posed.images;
  const auto together = images.begin() + shared.first + 1, apart = images.begin() + shared.second;
  std::rotate(together, apart, apart + 1);
  for (Track& track : scene.tracks) {
    for (TrackObservation& element : track.observations) {
      if (element.image == shared.second) {
        element.image = shared.first + 1;
      } else if (shared.first < element.image && element.image < shared.second) {
        ++element.image;
      }
    }
    std::sort(track.observations.begin(), track.observations.end(),
              [](const TrackObservation& a, const TrackObservation& b) { return a.image < b.image; });
  }
  return scene;
}

TEST_P(SharedDatabaseFrames, NeedNotHaveTheirImagesTogether) {
  SyntheticTracks scene = MakeTruth(1.5);
  for (int frame = 1; frame < 6; ++frame) DisturbWithPrior(frame, &scene.posed);
  Disturb(&scene, 1, 0.1, 0.05);
  const SyntheticTracks sorted = WithImagesTogether(scene, GetParam());
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  const BundleAdjustmentResult expected = AdjustBundle(sorted.posed, sorted.tracks, {});
  ASSERT_TRUE(result.summary.success && expected.summary.success);
  EXPECT_EQ(result.summary.iterations, expected.summary.iterations);
  for (int frame = 0; frame < 6; ++frame) {
    EXPECT_TRUE(result.frame_covariances[frame].isApprox(expected.frame_covariances[frame], 1e-6)) << frame;
    EXPECT_LE(PositionError(result.posed.frames[frame].frame_from_world, expected.posed.frames[frame].frame_from_world),
              1e-9);
  }
}

// Tries images of one frame that stand together, and images with others between them.
INSTANTIATE_TEST_SUITE_P(BundleAdjustment, SharedDatabaseFrames,
                         testing::Values(SharedFrame{1, 2}, SharedFrame{1, 4}, SharedFrame{3, 6}));

// Makes two query frames of two images each. Estimates the scales of both, whose given offsets are too short by a
// factor.
SyntheticTracks MakeRigs(double noise_px, double factor) {
  SyntheticTracksOptions options;
  options.num_query = 4;
  options.noise_px = noise_px;
  SyntheticTracks scene = MakeSyntheticTracks(options);
  JoinFrame(2, 3, &scene.posed);
  JoinFrame(0, 1, &scene.posed);
  for (const int query : {1, 3}) scene.posed.images[query].cam_from_frame.translation /= factor;
  for (const int frame : {0, 1}) scene.posed.frames[frame].has_free_scale = true;
  return scene;
}

TEST(BundleAdjustment, FreeScaleIsFoundExactlyWithoutNoise) {
  const SyntheticTracks truth = MakeRigs(0, 1);
  SyntheticTracks scene = MakeRigs(0, 1.25);
  scene.posed.frames[1].scale = 2;
  Disturb(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, Precise());
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  EXPECT_NEAR(result.posed.frames[0].scale, 1.25, 1e-8);
  EXPECT_NEAR(result.posed.frames[1].scale, 2 * 1.25, 1e-8) << "multiplies the estimate so far";
  for (int query = 0; query < 4; ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(truth.posed, query)), 1e-7);
    const Rigid3d& cam_from_frame = result.posed.images[query].cam_from_frame;
    EXPECT_LE((cam_from_frame.translation - truth.posed.images[query].cam_from_frame.translation).norm(), 1e-7);
    EXPECT_EQ(cam_from_frame.rotation.coeffs(), scene.posed.images[query].cam_from_frame.rotation.coeffs());
  }
}

TEST(BundleAdjustment, FreeScaleAgreesWithCeres) {
  SyntheticTracks scene = MakeRigs(1.5, 1.25);
  DisturbWithPrior(3, &scene.posed);
  Disturb(&scene, 1, 0.1, 0.05);
  const PosedImages reference = SolveWithCeres(scene, Precise());
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, Precise());
  ASSERT_TRUE(result.summary.success);
  for (const int frame : {0, 1}) {
    EXPECT_NEAR(result.posed.frames[frame].scale, reference.frames[frame].scale, 1e-5);
    EXPECT_GT(std::abs(result.posed.frames[frame].scale - 1.25), 1e-4) << "the noise has no effect";
  }
  for (int query = 0; query < 4; ++query) {
    EXPECT_LE(PositionError(CamFromWorld(result.posed, query), CamFromWorld(reference, query)), 1e-5);
  }
  // Expects a larger covariance of the second image of the rig, because the scale is unknown.
  PosedImages known = result.posed;
  for (Frame& frame : known.frames) frame.has_free_scale = false;
  EXPECT_GT(result.image_covariances[1].trace(),
            AdjustBundle(known, result.tracks, Precise()).image_covariances[1].trace());
}

TEST(BundleAdjustment, KnownRigOffsetsStayBitwise) {
  SyntheticTracks scene = MakeRigs(1, 1);
  scene.posed.frames[0].has_free_scale = false;
  Disturb(&scene, 1, 0.1, 0.05);
  const BundleAdjustmentResult result = AdjustBundle(scene.posed, scene.tracks, {});
  ASSERT_TRUE(result.summary.success);
  ExpectSameBits(result.posed.images[1].cam_from_frame, scene.posed.images[1].cam_from_frame);
  EXPECT_EQ(result.posed.frames[0].scale, 1);
  EXPECT_NE(result.posed.frames[1].scale, 1);
}

TEST(BundleAdjustment, RejectsFactorsThatAFrameHasNoParameterFor) {
  const SyntheticTracks rigs = MakeRigs(0, 1);
  const auto adjust_with_factors = [&](const std::vector<int>& images, bool has_free_scale) {
    PosedImages posed = rigs.posed;
    posed.frames[0].has_free_scale = has_free_scale;
    for (const int image : images) posed.images[image].log_focal_factor = 0;
    AdjustBundle(posed, rigs.tracks, {});
  };
  EXPECT_NO_THROW(adjust_with_factors({0}, false));
  EXPECT_THROW(adjust_with_factors({0}, true), std::logic_error) << "focal length and scale";
  EXPECT_THROW(adjust_with_factors({0, 1}, false), std::logic_error) << "two focal lengths";
  EXPECT_THROW(adjust_with_factors({4}, false), std::logic_error) << "a constant frame";
}

TEST(BundleAdjustmentOptions, NamesTheInvalidField) {
  BundleAdjustmentOptions options;
  std::string error;
  EXPECT_TRUE(options.Check(&error));
  options.max_num_iterations = 0;
  EXPECT_FALSE(options.Check(&error));
  EXPECT_THAT(error, testing::HasSubstr("max_num_iterations"));
}

}  // namespace
}  // namespace lazyloc
