#include "colmap_lazyloc/formats/control_point_file.h"

#include <set>

#include <gmock/gmock.h>

#include "colmap_lazyloc/testing/io_test.h"

namespace lazyloc {
namespace {

class ControlPointFile : public IoTest {
 protected:
  std::vector<ControlPoint> Read(const std::string& content) {
    const std::set<std::string> images = {"a.jpg", "b c 1.jpg"};
    return ReadControlPoints(WriteFile("points.txt", content),
                             [&](const std::string& name) { return images.count(name) > 0; });
  }
  void ExpectError(const std::string& content, const std::string& message) {
    EXPECT_EQ(ErrorOf([&] { Read(content); }), "points.txt" + message);
  }
};

TEST_F(ControlPointFile, PointsHaveTheMarksBelowThem) {
  const auto points = Read(
      "# comment\npoint GCP 1 1.5 -2 3e1 0.01 0.02 0.03\nmark a.jpg 10 20.5\nmark b c 1.jpg 5 6\n\n"
      "point 2 0 0 0 1 1 1\n mark a.jpg 7 8\n");
  ASSERT_EQ(points.size(), 2);
  EXPECT_EQ(points[0].name, "GCP 1");
  EXPECT_EQ(points[0].place, Eigen::Vector3d(1.5, -2, 30));
  EXPECT_EQ(points[0].stddevs, Eigen::Vector3d(0.01, 0.02, 0.03));
  ASSERT_EQ(points[0].marks.size(), 2);
  EXPECT_EQ(points[0].marks[1].image_name, "b c 1.jpg");
  EXPECT_EQ(points[0].marks[1].pixel, Eigen::Vector2d(5, 6));
  EXPECT_EQ(points[1].name, "2");
  EXPECT_EQ(points[1].marks.size(), 1);
}

TEST_F(ControlPointFile, MistakesAreNamedWithTheirLine) {
  const std::string point = "point P 1 2 3 1 1 1\n", mark = "mark a.jpg 1 2\n";
  const std::string form = "expected `point NAME x y z stddev_x stddev_y stddev_z` or `mark IMAGE x y`";
  ExpectError("", ": contains no point");
  ExpectError(mark, ":1: a mark comes before the first point");
  ExpectError(point, ": point 'P' has no mark");
  ExpectError(point + "point Q 1 2 3 1 1 1\n" + mark, ":2: point 'P' before has no mark");
  ExpectError(point + mark + point + mark, ":3: point 'P' is listed twice");
  ExpectError(point + mark + mark, ":3: 'a.jpg' has a mark of point 'P' before");
  ExpectError(point + "mark d.jpg 1 2\n", ":2: 'd.jpg' is neither a new photo nor a database image");
  ExpectError("P 1 2 3 1 1 1\n", ":1: " + form);
  ExpectError("point P 1 2 3 1 1\n", ":1: " + form);
  ExpectError("point 1 2 3 1 1 1\n", ":1: " + form);
  ExpectError(point + "mark a.jpg 1\n", ":2: " + form);
  ExpectError("point P 1 2 3 1 0 1\n", ":1: a standard deviation is not positive");
  ExpectError("point P 1 2 nan 1 1 1\n", ":1: a number is not finite");
  ExpectError("point P 1 x 3 1 1 1\n", ":1: 'x' is not a number");
}

}  // namespace
}  // namespace lazyloc
