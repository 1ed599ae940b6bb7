// Compares AdjustBundle with the same adjustment by Ceres.

#include <algorithm>
#include <cmath>
#include <ostream>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/refinement/ceres_bundle_adjustment.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct Setting {
  const char* name;
  int num_lone_queries = 1;
  bool has_priors = false;             // all but two of the database frames have a prior instead of an exact pose
  bool has_rig = false;                // a frame of three query images is adjusted too
  bool has_free_scale = false;         // its rig's scale starts 10 % too large
  bool has_free_focal_length = false;  // of the single queries but the last of several
  std::vector<int> shared = {};        // database images that share a frame
};

// Makes names of tests the same in every run: by default, GoogleTest prints the addresses in a setting.
void PrintTo(const Setting& setting, std::ostream* stream) { *stream << setting.name; }

constexpr int kNumDatabase = 6, kNumExact = 2, kNumRigImages = 3;
// Both solvers stop when the cost no longer falls. The cost is resolved to about 1e-13, and near the minimum it grows
// by half the square of the distance in standard deviations: both end within about 1e-6. Points differ more than poses
// because each has few observations.
constexpr double kMaxPoseDistanceSigma = 1e-6, kMaxPointDistanceSigma = 1e-5;
// AdjustBundle neglects the square of a rotation's deviation from its prior, which is a few times 1e-3 rad.
constexpr double kMaxCovarianceDifference = 5e-6;

class Settings : public testing::TestWithParam<Setting> {
 protected:
  // Makes the single queries, the rig, then the database images.
  SyntheticTracks MakeScene() const {
    SyntheticTracksOptions options;
    options.num_query = NumQueries();
    options.num_database = kNumDatabase;
    options.noise_px = 1.5;
    options.min_images_ratio = 0.5;
    SyntheticTracks scene = MakeSyntheticTracks(options);
    scene.posed.images.back().noise_px = 3;
    for (size_t i = 0; i < scene.tracks.size(); i += 4) scene.tracks[i].noise_ratio = 2;
    AddOutliers(&scene);
    for (int query = 0; query < NumFocalLengths(); ++query) FreeFocalLength(query, &scene);
    JoinFrames(&scene.posed);
    if (GetParam().has_priors) AddPriors(&scene.posed);
    DisturbQueries(&scene, 1, 0.1, 0.05);
    return scene;
  }

  int FirstOfRig() const { return GetParam().num_lone_queries; }
  int NumFocalLengths() const {
    return GetParam().has_free_focal_length ? std::max(1, GetParam().num_lone_queries - 1) : 0;
  }

 private:
  int NumQueries() const { return FirstOfRig() + (GetParam().has_rig ? kNumRigImages : 0); }

  static void AddOutliers(SyntheticTracks* scene) {
    Random random(5);
    for (int i = 0; i < 5; ++i) {
      TrackObservation& element = scene->tracks[i].observations.back();
      element.observation = ObserveAt(CamFromWorld(scene->posed, element.image) * scene->tracks[i].point_in_world, 500,
                                      30 * RandomVector(&random).head<2>());
    }
  }

  // Image points move away from the centre as the focal length grows.
  static void FreeFocalLength(int query, SyntheticTracks* scene) {
    scene->posed.images[query].log_focal_factor = 0.1;
    for (Track& track : scene->tracks) {
      Observation& observation = track.observations[query].observation;  // every query has all points
      const Eigen::Vector3d off_axis(observation.ray_in_cam.x(), observation.ray_in_cam.y(), 0);
      observation.px_from_log_focal = observation.px_from_cam * off_axis / observation.ray_in_cam.z();
    }
  }

  void JoinFrames(PosedImages* posed) const {
    for (size_t i = 1; i < GetParam().shared.size(); ++i) {
      JoinFrame(NumQueries() + GetParam().shared[0], NumQueries() + GetParam().shared[i], posed);
    }
    if (!GetParam().has_rig) return;
    const int first = FirstOfRig();
    for (int image = first + 1; image < first + kNumRigImages; ++image) {
      JoinFrame(first, image, posed);
      if (GetParam().has_free_scale) posed->images[image].cam_from_frame.translation *= 1.1;
    }
    posed->frames[posed->images[first].frame].has_free_scale = GetParam().has_free_scale;
  }

  void AddPriors(PosedImages* posed) const {
    Random random(7);
    const int first_database = posed->images[NumQueries()].frame;
    for (size_t i = first_database + kNumExact; i < posed->frames.size(); ++i) {
      Rigid3d& pose = posed->frames[i].frame_from_world;
      pose.rotation = Disturbed(pose.rotation, RadToDeg(2e-3), &random);
      pose.translation += 0.02 * RandomVector(&random);
      posed->frames[i].prior = PosePrior{pose, 2e-3, 0.02};
    }
    // Correlates the last two frames.
    const int last = static_cast<int>(posed->frames.size()) - 1;
    Eigen::Matrix2d shape;
    shape << 1, 0.6, 0.6, 2;
    posed->prior_groups = {{{last - 1, last}, {}}};
    posed->prior_groups[0].components = {{shape, 1.5},
                                         {Eigen::Matrix2d::Identity(), 0.1, PosePart::ROTATION},
                                         {Eigen::Matrix2d::Identity(), 0.5, PosePart::POSITION}};
  }
};

// Returns the Mahalanobis distance.
template <typename Vector, typename Matrix>
double DistanceSigma(const Vector& difference, const Matrix& covariance) {
  return covariance.llt().matrixL().solve(difference).norm();
}

Eigen::Matrix<double, 6, 1> PoseDifference(const Rigid3d& a, const Rigid3d& b) {
  Eigen::Matrix<double, 6, 1> difference;
  difference << LogSO3(a.rotation * b.rotation.conjugate()), a.translation - b.translation;
  return difference;
}

// Bounds the relative difference of the variances in all directions.
double CovarianceDifference(const Matrix6d& a, const Matrix6d& b) {
  const Eigen::LLT<Matrix6d> factor(b);
  const Matrix6d half = factor.matrixL().solve(a);
  const Matrix6d ratio = factor.matrixL().solve(half.transpose());
  return (ratio - Matrix6d::Identity()).norm();
}

void ExpectPosesAgree(const BundleAdjustmentResult& result, const CeresAdjustment& ceres, const PosedImages& start) {
  const std::vector<Rigid3d> adjusted = CamsFromWorld(result.posed), reference = CamsFromWorld(ceres.posed),
                             before = CamsFromWorld(start);
  for (size_t i = 0; i < adjusted.size(); ++i) {
    if (IsConstant(start.FrameOf(static_cast<int>(i)))) {
      EXPECT_EQ(result.image_covariances[i], Matrix6d::Zero()) << i;
      continue;
    }
    const Matrix6d& covariance = ceres.image_covariances[i];
    EXPECT_LE(DistanceSigma(PoseDifference(adjusted[i], reference[i]), covariance), kMaxPoseDistanceSigma) << i;
    EXPECT_GE(DistanceSigma(PoseDifference(adjusted[i], before[i]), covariance), 0.1) << i << " has not moved";
    EXPECT_LE(CovarianceDifference(result.image_covariances[i], covariance), kMaxCovarianceDifference) << i;
  }
}

void ExpectFactorAgrees(double log_factor, double reference, double start, double variance) {
  const double stddev = std::sqrt(variance);
  EXPECT_NEAR(log_factor, reference, kMaxPoseDistanceSigma * stddev);
  EXPECT_GE(std::abs(log_factor - start), 0.1 * stddev) << "has not moved";
}

TEST_P(Settings, AgreeWithCeres) {
  const SyntheticTracks start = MakeScene();
  BundleAdjustmentOptions options;
  options.convergence_sigma = 1e-9;  // leaves rounding errors only
  options.max_num_iterations = 500;
  const BundleAdjustmentResult result = AdjustBundle(start.posed, start.tracks, options);
  ASSERT_TRUE(result.summary.success) << result.summary.message;
  CeresOptions ceres_options;
  ceres_options.max_num_iterations = 500;
  ceres_options.function_tolerance = 1e-16;
  ceres_options.computes_covariances = true;
  const CeresAdjustment ceres = AdjustWithCeres(start.posed, start.tracks, ceres_options);
  ASSERT_TRUE(ceres.summary.success) << ceres.summary.message;
  EXPECT_NEAR(result.summary.cost, ceres.summary.cost, 1e-10 * ceres.summary.cost);
  ExpectPosesAgree(result, ceres, start.posed);
  for (size_t i = 0; i < start.tracks.size(); ++i) {
    const Eigen::Vector3d difference = result.tracks[i].point_in_world - ceres.tracks[i].point_in_world;
    EXPECT_LE(DistanceSigma(difference, ceres.point_covariances[i]), kMaxPointDistanceSigma) << i;
  }
  for (int query = 0; query < NumFocalLengths(); ++query) {
    const auto log_factor = [&](const PosedImages& posed) { return posed.images[query].log_focal_factor.value(); };
    ExpectFactorAgrees(log_factor(result.posed), log_factor(ceres.posed), log_factor(start.posed),
                       ceres.focal_variances[query].value());
  }
  if (GetParam().has_free_scale) {
    const int rig = start.posed.images[FirstOfRig()].frame;
    const auto log_scale = [&](const PosedImages& posed) { return std::log(posed.frames[rig].scale); };
    ExpectFactorAgrees(log_scale(result.posed), log_scale(ceres.posed), 0, ceres.scale_variances[rig].value());
    for (int i = 0; i < kNumRigImages; ++i) {
      const int image = FirstOfRig() + i;
      EXPECT_TRUE(result.posed.images[image].cam_from_frame.translation.isApprox(
          ceres.posed.images[image].cam_from_frame.translation, 1e-7));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(BundleAdjustment, Settings,
                         testing::Values(Setting{"OneQuery"}, Setting{"ThreeQueries", 3}, Setting{"Priors", 2, true},
                                         Setting{"Rig", 1, false, true}, Setting{"RigAlone", 0, false, true},
                                         Setting{"RigScale", 1, false, true, true},
                                         Setting{"FocalLength", 1, false, false, false, true},
                                         Setting{"FocalLengths", 3, false, false, false, true},
                                         Setting{"SharedPose", 1, true, false, false, false, {2, 3}},
                                         Setting{"SharedPoseApart", 1, true, false, false, false, {3, 5}},
                                         Setting{"Everything", 2, true, true, true, true, {2, 4, 5}}),
                         [](const auto& setting) { return std::string(setting.param.name); });

}  // namespace
}  // namespace lazyloc
