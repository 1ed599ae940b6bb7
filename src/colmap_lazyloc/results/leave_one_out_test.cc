#include "colmap_lazyloc/results/leave_one_out.h"

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/runs/records_test_fixture.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;

class LeaveOneOutTest : public RecordsTest {
 protected:
  // Adds an image of the model and its query, whose position is off along x.
  void Add(const std::string& name, double confidence, double error, QueryStatus status = QueryStatus::LOCALIZED) {
    const Eigen::Quaterniond rotation = ExpSO3({0.3, -0.2, 0.1});
    const Eigen::Vector3d centre(static_cast<double>(model_.images.size()), 0, 0);
    model_.images.push_back({1, 1, name, CamFromWorld(rotation, centre)});
    QueryRecord record;
    record.result.query_name = name;
    record.result.status = status;
    record.result.cam_from_world = CamFromWorld(rotation, centre + Eigen::Vector3d(error, 0, 0));
    record.result.confidence = confidence;
    record.result.evidence.scene_distance = 2;
    // The rotation is exact, so that the position has a standard deviation of 0.01 along each axis.
    record.result.covariance.diagonal() << 1e-16, 1e-16, 1e-16, 1e-4, 1e-4, 1e-4;
    records_.push_back(record);
  }
  // Returns the diagonal of the box around cameras in a row along x and around the points 2 units ahead of them.
  double SizeOfRow(double length) const {
    const Eigen::Vector3d axis = model_.images[0].cam_from_world.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    return (Eigen::Vector3d(length, 0, 0) + 2 * axis.cwiseAbs()).norm();
  }
  LeaveOneOutSummary Summarize() const { return SummarizeLeaveOneOut(model_, Stored(records_)); }

  Model model_;
  std::vector<QueryRecord> records_;
};

TEST_F(LeaveOneOutTest, ErrorsAreThoseAgainstTheModel) {
  Add("a", 0.9, 0.02);
  Add("b", 0.8, -0.03);
  const LeaveOneOutSummary summary = Summarize();
  ASSERT_EQ(summary.poses.size(), 2u);
  EXPECT_EQ(summary.poses[0].name, "a");
  EXPECT_NEAR(summary.poses[0].position_error, 0.02, 1e-12);
  EXPECT_NEAR(summary.poses[0].position_error_sigma, 2, 1e-3);
  EXPECT_NEAR(summary.poses[1].position_error_sigma, 3, 1e-3);
  EXPECT_NEAR(summary.poses[0].rotation_error_deg, 0, 1e-5);
  EXPECT_NEAR(summary.scene_size, SizeOfRow(1), 1e-12);
}

TEST_F(LeaveOneOutTest, WrongByStandardDeviationsAndByTheSceneSize) {
  for (int i = 0; i < 10; ++i) Add("right" + std::to_string(i), 0.9, 0);  // the cameras are 12 units apart
  Add("off by size alone, as it says", 0.5, 0.2);
  Add("off by standard deviations alone", 0.5, 0.055);
  Add("wrong by both", 0.5, 0.08);
  records_[10].result.covariance *= 100;
  const LeaveOneOutSummary summary = Summarize();
  EXPECT_NEAR(summary.scene_size, SizeOfRow(12), 1e-12);
  int num_wrong = 0;
  for (const CheckedPose& pose : summary.poses) {
    EXPECT_EQ(pose.is_wrong, pose.name.rfind("wrong", 0) == 0) << pose.name;
    num_wrong += pose.is_wrong;
  }
  EXPECT_EQ(num_wrong, 1);
}

TEST_F(LeaveOneOutTest, RiskAndCoverage) {
  Add("a", 0.9, 0);
  Add("b", 0.8, 1);
  Add("c", 0.8, 0);
  Add("d", 0.1, 1, QueryStatus::LOW_CONFIDENCE);
  Add("e", 0, 0, QueryStatus::NO_PAIRS);
  records_.back().result.confidence.reset();
  const LeaveOneOutSummary summary = Summarize();
  ASSERT_EQ(summary.risk_coverage.size(), 3u);
  EXPECT_DOUBLE_EQ(summary.risk_coverage[0].coverage, 0.2);
  EXPECT_DOUBLE_EQ(summary.risk_coverage[0].risk, 0);
  EXPECT_DOUBLE_EQ(summary.risk_coverage[1].coverage, 0.6);
  EXPECT_DOUBLE_EQ(summary.risk_coverage[1].risk, 1.0 / 3);
  EXPECT_DOUBLE_EQ(summary.risk_coverage[2].coverage, 0.8);
  EXPECT_DOUBLE_EQ(summary.risk_coverage[2].risk, 0.5);
  ASSERT_TRUE(summary.auroc);
  EXPECT_DOUBLE_EQ(*summary.auroc, (1 + 1 + 0.5 + 1) / 4);
  EXPECT_EQ(summary.num_by_status.at("LOCALIZED"), 3u);
}

TEST_F(LeaveOneOutTest, NoAurocWithoutWrongPoses) {
  Add("a", 0.9, 0);
  EXPECT_FALSE(Summarize().auroc);
}

TEST_F(LeaveOneOutTest, FileAndTextCountWhatIsAcceptedAndWrong) {
  Add("a", 0.9, 0);
  Add("b", 0.8, 1);
  Add("c", 0.1, 1, QueryStatus::LOW_CONFIDENCE);
  WriteLeaveOneOut(folder_ / "leave_one_out.json", Summarize());
  const auto json = nlohmann::json::parse(ReadFile(folder_ / "leave_one_out.json"));
  EXPECT_EQ(json["num_queries"], 3);
  EXPECT_EQ(json["num_accepted"], 2);
  EXPECT_EQ(json["num_accepted_and_wrong"], 1);
  EXPECT_EQ(json["num_by_status"]["LOW_CONFIDENCE"], 1);
  EXPECT_EQ(json["risk_coverage"].size(), 3u);
  EXPECT_EQ(json["poses"][2]["is_accepted"], false);
  EXPECT_THAT(FormatLeaveOneOut(Summarize()), HasSubstr("     1 of 2 "));
}

}  // namespace
}  // namespace lazyloc
