#include "colmap_lazyloc/queries/photo_camera.h"

#include <gmock/gmock.h>

#include "colmap_lazyloc/bridge/camera_models.h"

namespace lazyloc {
namespace {

using ::testing::ElementsAre;

constexpr int kSimpleRadial = 2, kOpenCv = 4;  // COLMAP's model ids

DatabaseCamera MakeDatabaseCamera(double focal_length_px, int num_images, const std::string& exif_camera = "") {
  return {{7, kSimpleRadial, 640, 480, {focal_length_px, 321, 242, 0.01}, false}, num_images, exif_camera};
}

class PhotoCameraTest : public ::testing::Test {
 protected:
  PhotoCamera Choose() const { return ChoosePhotoCamera(photo_, default_camera_, cameras_); }
  // Returns the focal length of the camera that is chosen from the database; 0 if none is.
  double SharedFocalLength() const {
    const PhotoCamera chosen = Choose();
    return chosen.source == IntrinsicsSource::DATABASE_CAMERA ? chosen.camera.params[0] : 0;
  }

  PhotoProperties photo_ = {640, 480, std::nullopt, ""};
  DefaultCamera default_camera_ = {kSimpleRadial, {}};
  std::vector<DatabaseCamera> cameras_;
};

TEST_F(PhotoCameraTest, GuessesLikeColmapWithoutAnySource) {
  photo_ = {480, 640, std::nullopt, ""};
  const PhotoCamera chosen = Choose();
  EXPECT_EQ(chosen.source, IntrinsicsSource::GUESS);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::GUESS);
  EXPECT_FALSE(chosen.camera.has_prior_focal_length);
  EXPECT_EQ(chosen.camera.width, 480u);
  EXPECT_THAT(chosen.camera.params, ElementsAre(1.2 * 640, 240, 320, 0));
}

TEST_F(PhotoCameraTest, ParametersOfTheOptionsComeFirst) {
  default_camera_.params = {500, 320, 240, 0};
  photo_.exif_focal_length_px = 700;
  cameras_ = {MakeDatabaseCamera(700, 5)};
  const PhotoCamera chosen = Choose();
  EXPECT_EQ(chosen.source, IntrinsicsSource::CAMERA_PARAMS);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::GIVEN);
  EXPECT_EQ(chosen.camera.params, default_camera_.params);
}

TEST_F(PhotoCameraTest, SameFocalLengthInExifMeansTheSameDevice) {
  photo_.exif_focal_length_px = 1500;
  cameras_ = {MakeDatabaseCamera(400, 9), MakeDatabaseCamera(700, 2)};
  cameras_[1].exif_focal_length_px = 1501;
  PhotoCamera chosen = Choose();
  EXPECT_EQ(chosen.source, IntrinsicsSource::DATABASE_CAMERA);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::MODEL) << "EXIF is far off for both in the same way";
  EXPECT_EQ(chosen.camera.params[0], 700);
  photo_.exif_camera = "Maker-One";
  cameras_[1].exif_camera = "Maker-Two";
  EXPECT_NE(Choose().Origin(), IntrinsicsOrigin::MODEL) << "another make";
  cameras_[1].exif_camera = "";
  cameras_[1].exif_focal_length_px = 1600;
  EXPECT_EQ(Choose().source, IntrinsicsSource::EXIF) << "another zoom";
}

TEST_F(PhotoCameraTest, CameraOfASingleImageIsOnlySimilar) {
  cameras_ = {MakeDatabaseCamera(690, 1), MakeDatabaseCamera(700, 1), MakeDatabaseCamera(705, 1)};
  const PhotoCamera chosen = Choose();
  EXPECT_EQ(chosen.source, IntrinsicsSource::DATABASE_CAMERA);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::SIMILAR);
  EXPECT_EQ(chosen.camera.params[0], 700);
  photo_.exif_focal_length_px = 650;
  for (DatabaseCamera& camera : cameras_) camera.exif_focal_length_px = 650;
  EXPECT_EQ(Choose().Origin(), IntrinsicsOrigin::SIMILAR) << "of the same device, which each image calibrates anew";
  cameras_[1].num_images = 2;
  EXPECT_EQ(Choose().Origin(), IntrinsicsOrigin::MODEL);
}

TEST(FocalLengthOfExif, IsThatWhichColmapFoundInExif) {
  Camera stored = CameraFromFocalLength(kSimpleRadial, 650, 640, 480);
  stored.has_prior_focal_length = true;
  EXPECT_EQ(FocalLengthOfExifPx(stored), 650);
  stored.has_prior_focal_length = false;
  EXPECT_EQ(FocalLengthOfExifPx(stored), std::nullopt);
}

TEST_F(PhotoCameraTest, CameraOfTheSameSizeComesBeforeExif) {
  photo_.exif_focal_length_px = 650;
  cameras_ = {MakeDatabaseCamera(700, 5)};
  const PhotoCamera chosen = Choose();
  EXPECT_EQ(chosen.source, IntrinsicsSource::DATABASE_CAMERA);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::SHARED);
  EXPECT_EQ(chosen.camera.camera_id, 0u);
  EXPECT_TRUE(SameIntrinsics(chosen.camera, cameras_[0].camera));
}

TEST_F(PhotoCameraTest, CameraOfAnotherSizeIsNotUsed) {
  photo_.width = 641;
  cameras_ = {MakeDatabaseCamera(700, 5)};
  EXPECT_EQ(Choose().source, IntrinsicsSource::GUESS);
  photo_.exif_focal_length_px = 650;
  const PhotoCamera chosen = Choose();
  EXPECT_EQ(chosen.source, IntrinsicsSource::EXIF);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::EXIF);
  EXPECT_THAT(chosen.camera.params, ElementsAre(650, 320.5, 240, 0));
}

TEST_F(PhotoCameraTest, MakeAndModelMustAgreeIfBothAreKnown) {
  cameras_ = {MakeDatabaseCamera(700, 5, "Maker-One")};
  EXPECT_EQ(SharedFocalLength(), 700) << "the photo's are unknown";
  photo_.exif_camera = "Maker-One";
  EXPECT_EQ(SharedFocalLength(), 700);
  photo_.exif_camera = "Maker-Two";
  EXPECT_EQ(SharedFocalLength(), 0);
  cameras_[0].exif_camera = "";
  EXPECT_EQ(SharedFocalLength(), 700) << "the database's are unknown";
}

TEST_F(PhotoCameraTest, ExifChoosesTheLens) {
  cameras_ = {MakeDatabaseCamera(400, 9), MakeDatabaseCamera(700, 2)};
  photo_.exif_focal_length_px = 680;
  EXPECT_EQ(SharedFocalLength(), 700);
  photo_.exif_focal_length_px = 1500;
  EXPECT_EQ(Choose().source, IntrinsicsSource::EXIF) << "another lens or zoom";
}

TEST(ChooseStoredCamera, ReplacesCamerasThatNobodyCalibrated) {
  const std::vector<DatabaseCamera> database_cameras = {MakeDatabaseCamera(700, 5)};
  Camera stored = CameraFromFocalLength(kSimpleRadial, 650, 640, 480);
  stored.camera_id = 3;
  stored.has_prior_focal_length = true;
  PhotoCamera chosen = ChooseStoredCamera(stored, database_cameras);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::SHARED);
  EXPECT_EQ(chosen.camera.params[0], 700);
  EXPECT_EQ(chosen.camera.camera_id, 3u);
  chosen = ChooseStoredCamera(stored, {});
  EXPECT_EQ(chosen.source, IntrinsicsSource::DATABASE);
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::EXIF);
  stored.params[3] = -0.01;
  chosen = ChooseStoredCamera(stored, database_cameras);
  EXPECT_TRUE(SameIntrinsics(chosen.camera, stored)) << "distortion is calibrated";
  EXPECT_EQ(chosen.Origin(), IntrinsicsOrigin::GIVEN);
  stored = CameraFromFocalLength(kSimpleRadial, GuessFocalLengthPx(640, 480), 640, 480);
  stored.has_prior_focal_length = false;
  chosen = ChooseStoredCamera(stored, database_cameras);
  EXPECT_EQ(chosen.camera.params[0], 700);
}

TEST_F(PhotoCameraTest, MostImagesDecideAmongSeveralCameras) {
  cameras_ = {MakeDatabaseCamera(400, 9), MakeDatabaseCamera(700, 2)};
  EXPECT_EQ(SharedFocalLength(), 400);
  cameras_ = {MakeDatabaseCamera(700, 9), MakeDatabaseCamera(400, 9), MakeDatabaseCamera(550, 1)};
  EXPECT_EQ(Choose().source, IntrinsicsSource::GUESS) << "no focal length has more than half of the images";
}

TEST_F(PhotoCameraTest, CamerasThatWereCalibratedForEachImageAgree) {
  for (const double focal_length_px : {700, 695, 1100, 702, 698}) {
    cameras_.push_back(MakeDatabaseCamera(focal_length_px, 1));
  }
  EXPECT_EQ(SharedFocalLength(), 700) << "the median";
}

TEST_F(PhotoCameraTest, TurnedPhotoHasTheMeanOfBothTurnedCameras) {
  photo_ = {480, 640, std::nullopt, ""};
  cameras_ = {{{7, kOpenCv, 640, 480, {700, 710, 300, 250, 0.1, 0.2, 0.3, 0.4}, false}, 5, ""}};
  const PhotoCamera chosen = Choose();
  EXPECT_EQ(chosen.source, IntrinsicsSource::DATABASE_CAMERA);
  EXPECT_EQ(chosen.camera.width, 480u);
  EXPECT_EQ(chosen.camera.height, 640u);
  EXPECT_THAT(chosen.camera.params, ElementsAre(710, 700, 240, 320, 0.1, 0.2, 0, 0));
  cameras_.push_back({{8, kSimpleRadial, 480, 640, {500, 240, 320, 0}, false}, 1, ""});
  EXPECT_EQ(SharedFocalLength(), 500) << "a camera that is not turned is preferred";
}

TEST_F(PhotoCameraTest, CameraWithoutFocalLengthIsNotUsed) {
  cameras_ = {{{7, *CameraModelId("EQUIRECTANGULAR"), 640, 480, {640, 480}, false}, 5, ""}};
  EXPECT_EQ(Choose().source, IntrinsicsSource::GUESS);
}

TEST(PhotoCamera, GuessInTheDatabaseIsAGuess) {
  const Camera guessed = CameraFromFocalLength(kSimpleRadial, GuessFocalLengthPx(640, 480), 640, 480);
  PhotoCamera camera = {guessed, IntrinsicsSource::DATABASE};
  camera.camera.has_prior_focal_length = false;
  EXPECT_EQ(camera.Origin(), IntrinsicsOrigin::GUESS);
  camera.source = IntrinsicsSource::QUERY_LIST;
  EXPECT_EQ(camera.Origin(), IntrinsicsOrigin::GIVEN);
}

TEST(ExifMakeAndModel, LeavesOutFocalLengthAndSize) {
  EXPECT_EQ(ExifMakeAndModel("Some-Maker-X-100-26 mm-640x480"), "Some-Maker-X-100");
  EXPECT_EQ(ExifMakeAndModel(""), "");
  EXPECT_EQ(ExifMakeAndModel("640x480"), "");
  EXPECT_EQ(ExifMakeAndModel("-640x480"), "");
}

class CamerasBySizeTest : public ::testing::Test {
 protected:
  // Adds a camera and images with it.
  void Add(uint32_t camera_id, uint64_t width, uint64_t height, int num_images) {
    model_.cameras[camera_id] = {camera_id, /*model_id=*/1, width, height, {500, 500, 320, 240}, false};
    for (int i = 0; i < num_images; ++i) {
      ModelImage image;
      image.camera_id = camera_id;
      model_.images.push_back(image);
    }
  }
  // Returns the ids of the cameras with a size.
  std::vector<uint32_t> IdsOfSize(uint64_t width, uint64_t height) const {
    const CamerasBySize cameras(model_, {});
    std::vector<uint32_t> ids;
    for (const DatabaseCamera& camera : cameras.OfSize(width, height)) {
      ids.push_back(camera.camera.camera_id);
    }
    return ids;
  }

  Model model_;
};

TEST_F(CamerasBySizeTest, MostUsedOnesComeFirst) {
  Add(1, 640, 480, 1);
  Add(2, 640, 480, 3);
  Add(3, 480, 640, 2);
  Add(4, 640, 481, 9);
  Add(5, 640, 480, 0);
  EXPECT_THAT(IdsOfSize(640, 480), ::testing::ElementsAre(2, 3, 1)) << "without an image, nothing tells of a camera";
  EXPECT_EQ(IdsOfSize(480, 640), IdsOfSize(640, 480));
  EXPECT_THAT(IdsOfSize(640, 482), ::testing::IsEmpty());
  EXPECT_EQ(CamerasBySize(model_, {}).OfSize(640, 480).front().num_images, 3);
}

TEST_F(CamerasBySizeTest, ThereAreAtMostAThousand) {
  for (uint32_t camera_id = 0; camera_id < 1200; ++camera_id) Add(camera_id, 640, 480, 1);
  EXPECT_EQ(IdsOfSize(640, 480).size(), 1000u);
}

}  // namespace
}  // namespace lazyloc
