#include "colmap_lazyloc/results/result_text.h"

#include <cmath>
#include <limits>
#include <sstream>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "colmap_lazyloc/bridge/camera_models.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/results/map_pose.h"
#include "colmap_lazyloc/runs/records_test_fixture.h"

namespace lazyloc {
namespace {

using Json = nlohmann::json;
using ::testing::HasSubstr;

QueryRecord Localized() {
  QueryRecord record;
  LocalizationResult& result = record.result;
  result.query_name = "my query.jpg";
  result.status = QueryStatus::LOCALIZED;
  result.cam_from_world = {Eigen::Quaterniond(-0.1, 0.2, 1.0 / 3, 0.9), {4000000.1, -2, 1e-17}};
  for (int i = 0; i < 36; ++i) result.covariance(i / 6, i % 6) = i;
  result.spread = {DegToRad(0.25), {0.3, 0.2, 0.1}, {0.6, 0, 0.8}};
  result.pairs = {{"a.jpg", 42, 0.5, std::numeric_limits<double>::quiet_NaN()}};
  result.num_tracks = 3;
  result.num_observations = 9;
  result.mean_reprojection_error_px = 0.75;
  record.seconds = {{"rotation", 0.5}, {"refinement", 1}};
  record.total_seconds = 1.75;
  record.intrinsics_source = IntrinsicsSource::DATABASE_CAMERA;
  record.matcher = MatcherType::ALIKED_LIGHTGLUE;
  return record;
}

QueryRecord Failed() {
  QueryRecord record;
  record.result.query_name = "night.jpg";
  record.result.status = QueryStatus::NO_PAIRS;
  record.result.reason = "no pair";
  return record;
}

class ResultText : public RecordsTest {
 protected:
  // Returns the lines that are not comments.
  std::vector<std::string> PoseLines(const std::vector<QueryRecord>& records) const {
    WritePoses(folder_ / "poses.txt", Stored(records));
    std::istringstream text(ReadFile(folder_ / "poses.txt"));
    std::vector<std::string> lines;
    for (std::string line; std::getline(text, line);) {
      if (line.front() != '#') lines.push_back(line);
    }
    return lines;
  }
  Json JsonOf(const QueryRecord& record, const WorldAxes& axes = {}) const {
    WriteResultsJson(folder_ / "results.jsonl", Stored({record}), axes);
    return Json::parse(ReadFile(folder_ / "results.jsonl"));
  }
};

TEST_F(ResultText, PosesAreExactAndOfLocalizedQueriesOnly) {
  const QueryRecord localized = Localized(), failed = Failed();
  const std::vector<std::string> lines = PoseLines({localized, failed});
  ASSERT_EQ(lines.size(), 1);
  EXPECT_EQ(lines[0],
            "my query.jpg 0.10000000000000001 -0.20000000000000001 -0.33333333333333331 -0.90000000000000002 "
            "4000000.1000000001 -2 1.0000000000000001e-17");
}

TEST_F(ResultText, PosesStateTheirConvention) {
  PoseLines({});
  const std::string text = ReadFile(folder_ / "poses.txt");
  for (const char* statement : {"name qw qx qy qz tx ty tz", "cam_from_world", "z forward", "unit of the database"}) {
    EXPECT_THAT(text, HasSubstr(statement));
  }
}

TEST_F(ResultText, NumbersDoNotDependOnTheLocale) {
  struct CommaDecimal : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  const QueryRecord localized = Localized();
  const std::string expected = PoseLines({localized}).at(0);
  const std::locale before = std::locale::global(std::locale(std::locale(), new CommaDecimal));
  const std::string line = PoseLines({localized}).at(0);
  std::locale::global(before);
  EXPECT_EQ(line, expected);
}

TEST_F(ResultText, JsonHoldsEverything) {
  const Json json = JsonOf(Localized());
  EXPECT_EQ(json["name"], "my query.jpg");
  EXPECT_EQ(json["status"], "LOCALIZED");
  EXPECT_EQ(json["reason"], "");
  EXPECT_EQ(json["cam_from_world"]["qvec"], Json({0.1, -0.2, -1.0 / 3, -0.9}));
  EXPECT_EQ(json["cam_from_world"]["tvec"], Json({4000000.1, -2.0, 1e-17}));
  ASSERT_EQ(json["covariance"].size(), 6);
  EXPECT_EQ(json["covariance"][1], Json({6.0, 7.0, 8.0, 9.0, 10.0, 11.0}));
  EXPECT_EQ(json["position"].size(), 3);
  EXPECT_EQ(json["position_stddevs"], Json({0.3, 0.2, 0.1}));
  EXPECT_EQ(json["weakest_direction"], Json({0.6, 0.0, 0.8}));
  EXPECT_EQ(json["rotation_stddev_deg"], 0.25);
  EXPECT_TRUE(json["rotation"].is_null() && json["bearing"].is_null());
  EXPECT_EQ(json["intrinsics_source"], "database_camera");
  EXPECT_EQ(json["matching_type"], "ALIKED_LIGHTGLUE");
  EXPECT_EQ(json["num_tracks"], 3);
  EXPECT_EQ(json["num_observations"], 9);
  EXPECT_EQ(json["mean_reprojection_error_px"], 0.75);
  EXPECT_EQ(json["pairs"], Json::parse(R"([{"name": "a.jpg", "num_inliers": 42, "rotation_error_deg": 0.5,
                                            "direction_error_deg": null}])"));
  EXPECT_EQ(json["seconds"], Json({{"rotation", 0.5}, {"refinement", 1.0}, {"total", 1.75}}));
}

TEST_F(ResultText, JsonHoldsThePoseInTheMapToTheLastBit) {
  QueryRecord record = Localized();
  record.result.cam_from_world = {Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), {1.0 / 3, -2, 5}};
  record.result.covariance = Eigen::Matrix<double, 6, 6>::Identity() / 7;
  const WorldAxes axes = {GeodeticPoint{47.3769, 8.5417, 408}};
  const MapPose pose = MakeMapPose(record.result, axes);
  const Json json = JsonOf(record, axes);
  EXPECT_EQ(json["world_from_cam"]["qvec"], Json({0.5, -0.5, 0.5, -0.5}));
  EXPECT_EQ(json["world_from_cam"]["tvec"], json["position"]);
  for (int row = 0; row < 6; ++row) {
    for (int col = 0; col < 6; ++col) {
      EXPECT_EQ(json["pose_covariance_in_map"][row][col], (*pose.covariance)(row, col));
      if (row < 3 && col < 3) {
        EXPECT_EQ(json["position_covariance"][row][col], (*pose.covariance)(row, col));
      }
    }
  }
  ASSERT_EQ(json["position_covariance"].size(), 3);
  EXPECT_EQ(json["heading_deg"], *pose.angles.heading.deg);
  EXPECT_EQ(json["top_heading_stddev_deg"], *pose.angles.top_heading.stddev_deg);
  EXPECT_NE(json["heading_deg"], JsonOf(record)["heading_deg"]) << "north is that at the camera's place";
}

TEST_F(ResultText, JsonHasNoDeviationsWithoutCovarianceAndNoAnglesWithoutConfidence) {
  QueryRecord record = Localized();
  record.result.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  Json json = JsonOf(record);
  EXPECT_TRUE(json["heading_deg"].is_number() && json["world_from_cam"].is_object());
  for (const char* field : {"heading_stddev_deg", "position_covariance", "pose_covariance_in_map"}) {
    EXPECT_TRUE(json[field].is_null()) << field;
  }
  record = Localized();
  record.result.status = QueryStatus::LOW_CONFIDENCE;
  json = JsonOf(record);
  for (const char* field : {"heading_deg", "pitch_stddev_deg", "world_from_cam", "pose_covariance_in_map"}) {
    EXPECT_TRUE(json[field].is_null()) << field;
  }
}

TEST_F(ResultText, JsonHasNoAnglesIfTheAxesAreArbitrary) {
  const Json json = JsonOf(Localized(), {std::nullopt, /*are_arbitrary=*/true});
  for (const char* angle : {"heading", "pitch", "roll", "top_heading"}) {
    for (const char* ending : {"_deg", "_stddev_deg"}) EXPECT_TRUE(json.at(std::string(angle) + ending).is_null());
  }
  EXPECT_TRUE(json["world_from_cam"].is_object() && json["pose_covariance_in_map"].is_array());
}

TEST_F(ResultText, JsonHoldsWhatCompetes) {
  QueryRecord record = Localized();
  record.result.confidence = 0.75;
  EXPECT_FALSE(JsonOf(record).contains("runner_up"));
  record.result.runner_up = RunnerUp{"a twin", {Eigen::Quaterniond::Identity(), {1, 2, 3}}, 0.25};
  EXPECT_EQ(JsonOf(record)["runner_up"],
            Json::parse(R"({"explanation": "a twin", "odds": 0.25, "position": [-1.0, -2.0, -3.0],
                            "cam_from_world": {"qvec": [1.0, 0.0, 0.0, 0.0], "tvec": [1.0, 2.0, 3.0]}})"));
}

TEST_F(ResultText, JsonHoldsWhatIsKnownOfAPoseWithoutPosition) {
  QueryRecord record = Failed();
  record.result.status = QueryStatus::SCALE_UNOBSERVABLE;
  record.result.partial_pose = {Eigen::Quaterniond(-0.5, 0.5, 0.5, -0.5), DegToRad(0.25),
                                Bearing{"a.jpg", {0, 1, 0}, DegToRad(0.5)}};
  const Json json = JsonOf(record);
  EXPECT_TRUE(json["cam_from_world"].is_null() && json["covariance"].is_null() && json["position_stddevs"].is_null());
  EXPECT_EQ(json["rotation"], Json({0.5, -0.5, -0.5, 0.5}));
  EXPECT_EQ(json["rotation_stddev_deg"], 0.25);
  EXPECT_EQ(json["bearing"], Json::parse(R"({"from": "a.jpg", "direction": [0.0, 1.0, 0.0], "stddev_deg": 0.5})"));
  record.result.partial_pose = {Eigen::Quaterniond::Identity(), std::nullopt, std::nullopt};
  EXPECT_TRUE(JsonOf(record)["bearing"].is_null() && JsonOf(record)["rotation_stddev_deg"].is_null());
  EXPECT_EQ(PoseLines({record}).size(), 0);
}

TEST_F(ResultText, PoseOfLowConfidenceIsNotOneToRelyOn) {
  QueryRecord record = Localized();
  record.result.confidence = 0.25;
  record.result.evidence.explained_ratio = 0.125;
  record.result.evidence.scene_distance = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(JsonOf(record)["confidence"], 0.25);
  EXPECT_TRUE(JsonOf(record)["unconfirmed_cam_from_world"].is_null());
  record.result.status = QueryStatus::LOW_CONFIDENCE;
  const Json json = JsonOf(record);
  EXPECT_TRUE(json["cam_from_world"].is_null() && json["position"].is_null());
  EXPECT_EQ(json["unconfirmed_cam_from_world"]["tvec"], Json({4000000.1, -2.0, 1e-17}));
  EXPECT_EQ(json["position_stddevs"], Json({0.3, 0.2, 0.1}));
  EXPECT_EQ(json["confidence"], 0.25);
  EXPECT_EQ(json["evidence"]["explained_ratio"], 0.125);
  EXPECT_TRUE(json["evidence"]["scene_distance"].is_null()) << "unknown";
  EXPECT_EQ(PoseLines({record}).size(), 0);
}

TEST_F(ResultText, JsonKeepsTheOrderOfKeys) {
  QueryRecord record = Failed();
  record.seconds = {{"load", 1}, {"a", 0.25}};
  record.total_seconds = 1.5;
  JsonOf(record);
  EXPECT_EQ(
      ReadFile(folder_ / "results.jsonl"),
      R"({"name":"night.jpg","status":"NO_PAIRS","reason":"no pair","start":"","confidence":null,"evidence":null,)"
      R"("cam_from_world":null,"unconfirmed_cam_from_world":null,)"
      R"("covariance":null,"position":null,)"
      R"("position_stddevs":null,"weakest_direction":null,"rotation_stddev_deg":null,"rotation":null,"bearing":null,)"
      R"("world_from_cam":null,"position_covariance":null,"pose_covariance_in_map":null,)"
      R"("heading_deg":null,"heading_stddev_deg":null,"pitch_deg":null,"pitch_stddev_deg":null,)"
      R"("roll_deg":null,"roll_stddev_deg":null,"top_heading_deg":null,"top_heading_stddev_deg":null,)"
      R"("frame":null,"rig_from_world":null,"rig_error_px":null,)"
      R"("intrinsics":{"origin":"given","verdict":"not_tested","focal_factor":null,"focal_factor_stddev":null,)"
      R"("contradiction":null},"intrinsics_source":null,"num_tracks":0,"num_observations":0,"mean_reprojection_error_px":null,"pairs":[],)"
      R"("seconds":{"load":1.0,"a":0.25,"total":1.5}})"
      "\n");
}

TEST_F(ResultText, JsonIsValidForAnyBytesInNames) {
  QueryRecord record = Failed();
  record.result.query_name = "caf\xE9 \"1\".jpg";  // Latin-1
  EXPECT_EQ(JsonOf(record)["name"], "caf\\xe9 \"1\".jpg");
}

TEST_F(ResultText, JsonHasALineForEveryQuery) {
  const QueryRecord localized = Localized(), failed = Failed();
  WriteResultsJson(folder_ / "results.jsonl", Stored({localized, failed}), {});
  std::istringstream text(ReadFile(folder_ / "results.jsonl"));
  std::string first, second, rest;
  std::getline(text, first);
  std::getline(text, second);
  EXPECT_EQ(Json::parse(first)["name"], "my query.jpg");
  EXPECT_EQ(Json::parse(second)["name"], "night.jpg");
  EXPECT_FALSE(std::getline(text, rest));
}

TEST_F(ResultText, RigsHaveAPoseEachUnderTheNameOfTheFrame) {
  QueryRecord left = Localized(), right = Localized(), failed = Failed();
  left.result.frame_name = right.result.frame_name = "1.jpg";
  left.result.rig_from_world = {Eigen::Quaterniond::Identity(), {1, 2, 3}};
  right.result.rig_from_world = {Eigen::Quaterniond::Identity(), {1, 2, 4}};
  right.result.query_name = "right.jpg";
  failed.result.frame_name = "2.jpg";
  WriteRigPoses(folder_ / "rig_poses.txt", Stored({left, right, failed}));
  EXPECT_THAT(ReadFile(folder_ / "rig_poses.txt"), ::testing::EndsWith("\n1.jpg 1 0 0 0 1 2 3\n"));
  WriteRigPoses(folder_ / "none.txt", Stored({Localized(), failed}));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none.txt"));
}

TEST_F(ResultText, FullDiskIsReported) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP();
  const QueryRecord localized = Localized();
  EXPECT_THAT(ErrorOf([&] { WritePoses("/dev/full", Stored({localized})); }),
              HasSubstr("/dev/full: cannot be written"));
  EXPECT_THAT(ErrorOf([&] { WriteResultsJson(folder_ / "none" / "x", Stored({}), {}); }),
              HasSubstr("none/x: cannot be written"));
}

TEST_F(ResultText, CameraIsWrittenWhereItWasRefined) {
  QueryRecord record = Localized();
  record.result.query_camera = {3, *CameraModelId("PINHOLE"), 640, 480, {500, 1.0 / 3, 320, 240}, false};
  EXPECT_FALSE(JsonOf(record).contains("camera"));
  record.result.is_camera_refined = true;
  EXPECT_EQ(JsonOf(record)["camera"],
            Json({{"model", "PINHOLE"}, {"width", 640}, {"height", 480}, {"params", {500, 1.0 / 3, 320, 240}}}));
}

}  // namespace
}  // namespace lazyloc
