#include "colmap_lazyloc/bridge/reprojection_cost.h"

#include <memory>
#include <vector>

#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

const Eigen::Vector3d kPoint(0.4, -0.3, 5);
const std::vector<double> kParams = {600, 610, 320, 240, -0.1, 0.02, 0.001, -0.002};

// Compares the derivatives of a cost with central differences.
template <typename Placement>
void ExpectRightDerivatives(const Placement& placement, const std::vector<double>& pose) {
  const std::unique_ptr<ceres::CostFunction> cost(
      MakeReprojectionCost(*CameraModelId("OPENCV"), Eigen::Vector2d(370, 200), 0.5, placement));
  ASSERT_TRUE(cost);
  const double* blocks[] = {pose.data(), kPoint.data(), kParams.data()};
  const ceres::GradientChecker checker(cost.get(), static_cast<std::vector<const ceres::Manifold*>*>(nullptr),
                                       ceres::NumericDiffOptions());
  ceres::GradientChecker::ProbeResults results;
  EXPECT_TRUE(checker.Probe(blocks, 1e-6, &results)) << results.error_log;
}

TEST(ReprojectionCost, DerivativesByAPhoto) {
  const Eigen::Quaterniond turned(ExpSO3({0.2, -0.1, 0.3}));
  for (const Eigen::Quaterniond& rotation : {Eigen::Quaterniond::Identity(), turned}) {
    const Eigen::Vector4d q = rotation.coeffs();
    ExpectRightDerivatives(PhotoPlacement(), {q[0], q[1], q[2], q[3], 0.1, -0.2, 0.3});
  }
}

TEST(ReprojectionCost, DerivativesByADatabaseImage) {
  const PosePrior prior = {{ExpSO3({0.1, 0.2, -0.3}), {0.3, 0.1, -0.2}}, 0.02, 0.05};
  ExpectRightDerivatives(DatabasePlacement{prior}, {0, 0, 0, 0, 0, 0});
  ExpectRightDerivatives(DatabasePlacement{prior}, {1, -2, 0.5, 2, 1, -1});
}

}  // namespace
}  // namespace lazyloc
