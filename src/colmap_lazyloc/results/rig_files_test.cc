#include <gmock/gmock.h>

#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/results/model_writer.h"
#include "colmap_lazyloc/runs/records_test_fixture.h"
#include "colmap_lazyloc/testing/test_database.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;
using ::testing::SizeIs;
using ::testing::StartsWith;

constexpr char kCameras[] = "1 SIMPLE_PINHOLE 640 480 500 320 240\n2 SIMPLE_PINHOLE 640 480 600 320 240\n";
constexpr char kImages[] = "10 1 0 0 0 0 0 0 1 left.jpg\n\n11 1 0 0 0 1 0 0 2 right.jpg\n\n";
constexpr char kRigs[] = "# a comment\n5 3 CAMERA 1 CAMERA 2 1 0 0.6 0.8 0 1 2.5 3 IMU 7 0\n";
constexpr char kFrames[] = "3 5 0.5 0.5 0.5 -0.5 0.1 0.2 0.3 3 CAMERA 1 10 CAMERA 2 11 IMU 7 99\n";

class RigFilesTest : public RecordsTest {
 protected:
  Model ReadText(const std::string& rigs, const std::string& frames) {
    WriteFile("cameras.txt", kCameras);
    WriteFile("images.txt", kImages);
    WriteFile("rigs.txt", rigs);
    WriteFile("frames.txt", frames);
    return ReadModel(folder_);
  }
  std::string ErrorOfText(const std::string& rigs, const std::string& frames) {
    return ErrorOf([&] { ReadText(rigs, frames); });
  }
  // Writes a model into model/ and reads it again.
  Model WrittenAndRead(const Model& model) const {
    TestDatabase database(folder_ / "database.db", TestDatabase::Schema::V4_2);
    database.Close();
    std::filesystem::create_directory(folder_ / "model");
    const DatabaseReader reader(folder_ / "database.db");
    WriteModel(folder_ / "model", folder_ / "scratch", model, Stored({}), {reader, reader.ReadImages()});
    return ReadModel(folder_ / "model");
  }
};

std::vector<double> Numbers(const Rigid3d& pose) {
  return {pose.rotation.w(),    pose.rotation.x(),    pose.rotation.y(),   pose.rotation.z(),
          pose.translation.x(), pose.translation.y(), pose.translation.z()};
}

std::vector<uint64_t> DataIds(const ModelFrame& frame) {
  std::vector<uint64_t> ids;
  for (const FrameData& data : frame.data) ids.push_back(data.data_id);
  return ids;
}

MergedModel Merged(const Model& model) {
  MergedModel merged;
  for (const ModelImage& image : model.images) merged.images.push_back({image.image_id, image.camera_id});
  KeepRigs(model, &merged);
  return merged;
}

void ExpectTheRigAndItsFrame(const Model& model) {
  ASSERT_THAT(model.rigs, ElementsAre(Pair(5, testing::_)));
  const Rig& rig = model.rigs.at(5);
  EXPECT_EQ(rig.reference, (Sensor{SensorType::CAMERA, 1}));
  ASSERT_THAT(rig.others, SizeIs(2));
  EXPECT_EQ(rig.others[0].sensor, (Sensor{SensorType::CAMERA, 2}));
  EXPECT_THAT(Numbers(rig.others[0].sensor_from_rig.value()), ElementsAre(0, 0.6, 0.8, 0, 1, 2.5, 3));
  EXPECT_EQ(rig.others[1].sensor, (Sensor{SensorType::IMU, 7}));
  EXPECT_FALSE(rig.others[1].sensor_from_rig.has_value());
  ASSERT_THAT(model.frames, ElementsAre(Pair(3, testing::_)));
  const ModelFrame& frame = model.frames.at(3);
  EXPECT_EQ(frame.rig_id, 5);
  EXPECT_THAT(Numbers(frame.rig_from_world), ElementsAre(0.5, 0.5, 0.5, -0.5, 0.1, 0.2, 0.3));
  EXPECT_THAT(DataIds(frame), ElementsAre(10, 11, 99));
  EXPECT_EQ(frame.data[2].sensor, (Sensor{SensorType::IMU, 7}));
}

TEST_F(RigFilesTest, TextIsReadExactly) { ExpectTheRigAndItsFrame(ReadText(kRigs, kFrames)); }

TEST_F(RigFilesTest, BinaryHoldsWhatTheTextHeld) { ExpectTheRigAndItsFrame(WrittenAndRead(ReadText(kRigs, kFrames))); }

TEST_F(RigFilesTest, ModelWithoutRigsIsWrittenWithout) {
  WriteFile("cameras.txt", kCameras);
  WriteFile("images.txt", kImages);
  const Model model = WrittenAndRead(ReadModel(folder_));
  EXPECT_THAT(model.rigs, IsEmpty());
  EXPECT_THAT(model.frames, IsEmpty());
  EXPECT_FALSE(std::filesystem::exists(folder_ / "model" / "rigs.bin"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "model" / "frames.bin"));
}

TEST_F(RigFilesTest, TruncatedBinaryIsRefusedAtEveryLength) {
  WrittenAndRead(ReadText(kRigs, kFrames));
  for (const std::string name : {"rigs.bin", "frames.bin"}) {
    const std::string bytes = ReadFile(folder_ / "model" / name);
    for (size_t length = 0; length < bytes.size(); ++length) {
      WriteFile("model/" + name, bytes.substr(0, length));
      EXPECT_THAT(ErrorOf([&] { ReadModel(folder_ / "model"); }), StartsWith("model/" + name + ": ")) << length;
    }
    WriteFile("model/" + name, bytes);
  }
}

TEST_F(RigFilesTest, MistakesAreNamed) {
  EXPECT_THAT(ErrorOfText("5 1 CAMERA 3\n", ""), StartsWith("rigs.txt:1: rig 5: its camera 3 is missing"));
  EXPECT_THAT(ErrorOfText("5 1 RADAR 1\n", ""), StartsWith("rigs.txt:1: unknown sensor type 'RADAR'"));
  EXPECT_THAT(ErrorOfText("5 1 CAMERA 1\n5 0\n", ""), StartsWith("rigs.txt:2: rig 5 appears twice"));
  EXPECT_THAT(ErrorOfText("5 2 CAMERA 1 CAMERA 2 1 0 0 0 0 1 2 3\n", ""), HasSubstr("quaternion is zero"));
  EXPECT_THAT(ErrorOfText(kRigs, "3 6 1 0 0 0 0 0 0 0\n"), StartsWith("frames.txt:1: frame 3: its rig 6 is missing"));
  EXPECT_THAT(ErrorOfText(kRigs, "3 5 1 0 0 0 0 0 0 1 CAMERA 4 10\n"), HasSubstr("camera 4, which is not of the"));
  EXPECT_THAT(ErrorOfText(kRigs, std::string(kFrames) + "4 5 1 0 0 0 0 0 0 1 CAMERA 1 10\n"),
              StartsWith("frames.txt:2: frame 4: image 10 appears twice"));
  EXPECT_THAT(ErrorOfText(kRigs, "3 5 1 0 0 0 0 0 0 1 CAMERA 1 10\n"),
              StartsWith("images.txt:3: image 11 ('right.jpg') is in no frame with its camera 2"));
  EXPECT_THAT(ErrorOfText(kRigs, "3 5 1 0 0 0 0 0 0 2 CAMERA 1 10 CAMERA 1 11\n"), HasSubstr("is in no frame"));
}

TEST_F(RigFilesTest, ImagesThatAreGoneLeaveTheirFrames) {
  Model model = ReadText(kRigs, kFrames);
  model.images.pop_back();
  EXPECT_THAT(DataIds(Merged(model).frames.at(3)), ElementsAre(10, 99));
  model.images.clear();
  const MergedModel merged = Merged(model);
  EXPECT_THAT(merged.frames, IsEmpty());
  EXPECT_THAT(merged.rigs, SizeIs(1));
}

TEST_F(RigFilesTest, NewImageGetsAFrameOfItsCamerasRig) {
  MergedModel merged = Merged(ReadText(kRigs, kFrames));
  const Rigid3d pose = {Eigen::Quaterniond(0.1, 0.7, 0.1, 0.7), {7, 8, 9}};
  AddFrameOfOneImage({20, /*camera_id=*/1, "of the reference camera", pose}, &merged);
  AddFrameOfOneImage({3, /*camera_id=*/2, "of the other camera, its id a frame's", pose}, &merged);
  EXPECT_THAT(merged.rigs, SizeIs(1));
  EXPECT_EQ(merged.frames.at(20).rig_id, 5);
  EXPECT_THAT(DataIds(merged.frames.at(20)), ElementsAre(20));
  EXPECT_EQ(Numbers(merged.frames.at(20).rig_from_world), Numbers(pose));
  const ModelFrame& frame = merged.frames.at(21);
  EXPECT_EQ(frame.rig_id, 5);
  EXPECT_THAT(DataIds(frame), ElementsAre(3));
  const Rigid3d composed = merged.rigs.at(5).others[0].sensor_from_rig.value() * frame.rig_from_world;
  EXPECT_LT(composed.rotation.angularDistance(pose.rotation), 1e-7);
  EXPECT_LT((composed.translation - pose.translation).norm(), 1e-14);
}

TEST_F(RigFilesTest, NewCameraGetsARigOfItsOwn) {
  MergedModel merged = Merged(ReadText("1 2 CAMERA 1 CAMERA 2 0\n", "3 1 1 0 0 0 0 0 0 2 CAMERA 1 10 CAMERA 2 11\n"));
  AddFrameOfOneImage({20, /*camera_id=*/9, "of a new camera", {}}, &merged);
  AddFrameOfOneImage({21, /*camera_id=*/9, "of the same", {}}, &merged);
  AddFrameOfOneImage({22, /*camera_id=*/2, "of a camera whose place on its rig is unknown", {}}, &merged);
  ASSERT_THAT(merged.rigs, SizeIs(3));
  EXPECT_EQ(merged.rigs.at(9).reference, (Sensor{SensorType::CAMERA, 9}));
  EXPECT_EQ(merged.frames.at(20).rig_id, 9);
  EXPECT_EQ(merged.frames.at(21).rig_id, 9);
  EXPECT_EQ(merged.rigs.at(2).reference, (Sensor{SensorType::CAMERA, 2}));
  EXPECT_EQ(merged.frames.at(22).rig_id, 2);
}

}  // namespace
}  // namespace lazyloc
