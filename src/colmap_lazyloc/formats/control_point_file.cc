#include "colmap_lazyloc/formats/control_point_file.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string_view>
#include <utility>

#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

constexpr char kForm[] = "expected `point NAME x y z stddev_x stddev_y stddev_z` or `mark IMAGE x y`";

// Takes numbers from the end of a line. Returns them in their order.
std::vector<double> TakeNumbers(const TextFile& file, size_t count, std::string_view* line) {
  std::vector<double> numbers;
  for (size_t i = 0; i < count; ++i) {
    const size_t blank = line->find_last_of(" \t");
    if (blank == std::string_view::npos) throw file.Error(kForm);
    numbers.push_back(file.ParseNumber<double>(line->substr(blank + 1)));
    if (!std::isfinite(numbers.back())) throw file.Error("a number is not finite");
    *line = Trimmed(line->substr(0, blank));
  }
  std::reverse(numbers.begin(), numbers.end());
  return numbers;
}

ControlPoint ParsePoint(const TextFile& file, std::string_view rest) {
  const std::vector<double> numbers = TakeNumbers(file, 6, &rest);
  if (*std::min_element(numbers.begin() + 3, numbers.end()) <= 0) {
    throw file.Error("a standard deviation is not positive");
  }
  return {std::string(rest), {numbers[0], numbers[1], numbers[2]}, {numbers[3], numbers[4], numbers[5]}, {}};
}

ControlMark ParseMark(const TextFile& file, std::string_view rest) {
  const std::vector<double> numbers = TakeNumbers(file, 2, &rest);
  return {std::string(rest), {numbers[0], numbers[1]}};
}

}  // namespace

std::vector<ControlPoint> ReadControlPoints(const std::filesystem::path& path,
                                            const std::function<bool(const std::string&)>& is_image) {
  TextFile file(path);
  std::vector<ControlPoint> points;
  std::set<std::string> names;   // of points
  std::set<std::string> images;  // with marks of the last point
  const auto check_marks = [&] {
    if (!points.empty() && images.empty()) throw file.Error("point '" + points.back().name + "' before has no mark");
  };
  while (file.NextEntry()) {
    std::string_view rest = file.Line();
    const std::string_view word = NextWord(&rest);
    if (word == "point") {
      check_marks();
      points.push_back(ParsePoint(file, Trimmed(rest)));
      if (!names.insert(points.back().name).second) {
        throw file.Error("point '" + points.back().name + "' is listed twice");
      }
      images.clear();
    } else if (word == "mark") {
      if (points.empty()) throw file.Error("a mark comes before the first point");
      ControlMark mark = ParseMark(file, Trimmed(rest));
      if (!is_image(mark.image_name)) {
        throw file.Error("'" + mark.image_name + "' is neither a new photo nor a database image");
      }
      if (!images.insert(mark.image_name).second) {
        throw file.Error("'" + mark.image_name + "' has a mark of point '" + points.back().name + "' before");
      }
      points.back().marks.push_back(std::move(mark));
    } else {
      throw file.Error(kForm);
    }
  }
  if (points.empty()) throw InputError(path.string() + ": contains no point");
  if (images.empty()) throw InputError(path.string() + ": point '" + points.back().name + "' has no mark");
  return points;
}

}  // namespace lazyloc
