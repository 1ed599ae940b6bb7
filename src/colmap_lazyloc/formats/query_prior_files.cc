#include "colmap_lazyloc/formats/query_prior_files.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>
#include <utility>

#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/files/text_file.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// Minimum ratio of the variances along the principal axes of a covariance, because a smaller one is not distinct from
// zero in the arithmetic of computers.
constexpr double kMinVarianceRatio = 1e-12;

struct Line {
  std::string name;
  std::vector<double> numbers;
};

// Splits a line before its last words. Returns the name; sets the words.
std::string SplitBeforeLast(std::string_view line, size_t num_words, std::vector<std::string_view>* words) {
  words->clear();
  for (size_t i = 0; i < num_words; ++i) {
    const size_t blank = line.find_last_of(" \t");
    if (blank == std::string_view::npos) return "";
    words->insert(words->begin(), line.substr(blank + 1));
    line = Trimmed(line.substr(0, blank));
  }
  return std::string(line);
}

// Returns the name and the numbers of a line. Of several queries that it may name, the longest name counts, because
// names may hold blanks and numbers.
Line ParseLine(const TextFile& file, const std::vector<size_t>& num_numbers, const char* form,
               const std::function<bool(const std::string&)>& is_query) {
  std::vector<std::string_view> words;
  for (const size_t count : num_numbers) {
    Line line{SplitBeforeLast(file.Line(), count, &words), {}};
    if (line.name.empty() || !is_query(line.name)) continue;
    for (const std::string_view word : words) line.numbers.push_back(file.ParseNumber<double>(word));
    return line;
  }
  std::string_view rest = file.Line();
  const std::string first(NextWord(&rest));
  if (is_query(first)) throw file.Error(std::string("expected ") + form);
  const std::string name = SplitBeforeLast(file.Line(), num_numbers.front(), &words);
  throw file.Error("'" + (name.empty() ? first : name) + "' is not the name of a query; expected " + form);
}

// Reads the priors of one kind from the lines of a file, if there is one.
template <typename Prior, typename Make>
void ReadPriorFile(const std::string& path, const std::vector<size_t>& num_numbers, const char* form,
                   const std::function<bool(const std::string&)>& is_query, std::optional<Prior> QueryPrior::*kind,
                   const Make& make, std::map<std::string, QueryPrior>* priors) {
  if (path.empty()) return;
  TextFile file(path);
  if (!file.NextEntry()) throw InputError(path + ": contains no query");
  do {
    const Line line = ParseLine(file, num_numbers, form, is_query);
    std::optional<Prior>& prior = (*priors)[line.name].*kind;
    const bool is_new = !prior;
    try {
      prior = make(line.numbers);
    } catch (const InputError& error) {
      throw file.Error(error.what());
    }
    if (!is_new) throw file.Error("query '" + line.name + "' is listed twice");
  } while (file.NextEntry());
}

void CheckFinite(const std::vector<double>& numbers) {
  for (const double number : numbers) {
    if (!std::isfinite(number)) throw InputError("a number is not finite");
  }
}

std::optional<Eigen::Vector3d> ParseDirection(std::string text) {
  std::replace(text.begin(), text.end(), ',', ' ');
  std::string_view rest = text;
  Eigen::Vector3d direction;
  for (double& number : direction) {
    const std::optional<double> parsed = NumberFrom<double>(NextWord(&rest));
    if (!parsed) return std::nullopt;
    number = *parsed;
  }
  if (!NextWord(&rest).empty() || !direction.allFinite() || direction.isZero()) return std::nullopt;
  return direction.normalized();
}

}  // namespace

bool QueryPriorOptions::Check(std::string* error) const {
  if (!world_up.empty() && !ParseDirection(world_up)) {
    *error = "world_up must be a direction x,y,z, for example 0,0,1, but is '" + world_up + "'";
    return false;
  }
  if (!gravity_path.empty() && world_up.empty()) {
    *error = "query_gravity_path needs --LazyLocalizer.world_up, the direction against gravity in the model";
    return false;
  }
  return true;
}

PositionPrior MakePositionPrior(const std::vector<double>& numbers) {
  CheckFinite(numbers);
  PositionPrior prior;
  prior.position = {numbers[0], numbers[1], numbers[2]};
  const std::vector<double> rest(numbers.begin() + 3, numbers.end());
  if (rest.size() == 6) {
    prior.covariance << rest[0], rest[1], rest[2], rest[1], rest[3], rest[4], rest[2], rest[4], rest[5];
    const Eigen::Vector3d variances =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(prior.covariance, Eigen::EigenvaluesOnly).eigenvalues();
    if (!(variances[0] > kMinVarianceRatio * variances[2])) throw InputError("the covariance is not positive definite");
    return prior;
  }
  if (std::any_of(rest.begin(), rest.end(), [](double stddev) { return stddev <= 0; })) {
    throw InputError("a standard deviation is not positive");
  }
  const Eigen::Vector3d stddevs =
      rest.size() == 1 ? Eigen::Vector3d::Constant(rest[0]) : Eigen::Vector3d(rest[0], rest[1], rest[2]);
  prior.covariance = stddevs.cwiseAbs2().asDiagonal();
  return prior;
}

GravityPrior MakeGravityPrior(const std::vector<double>& numbers, const std::string& world_up) {
  CheckFinite(numbers);
  const Eigen::Vector3d down(numbers[0], numbers[1], numbers[2]);
  if (down.isZero(0)) throw InputError("the direction of gravity is zero");
  if (numbers[3] <= 0) throw InputError("the standard deviation is not positive");
  const std::optional<Eigen::Vector3d> up = ParseDirection(world_up);
  if (!up) throw InputError("gravity needs LazyLocalizer.world_up");
  return {down.stableNormalized(), -*up, DegToRad(numbers[3])};
}

std::map<std::string, QueryPrior> ReadQueryPriors(const QueryPriorOptions& options,
                                                  const std::function<bool(const std::string&)>& is_query) {
  std::map<std::string, QueryPrior> priors;
  ReadPriorFile(options.position_path, {4, 6, 9},
                "`name x y z` and one or three standard deviations, or six numbers of a covariance", is_query,
                &QueryPrior::position, MakePositionPrior, &priors);
  const auto make_gravity = [&](const std::vector<double>& numbers) {
    return MakeGravityPrior(numbers, options.world_up);
  };
  ReadPriorFile(options.gravity_path, {4}, "`name gx gy gz stddev_deg`", is_query, &QueryPrior::gravity, make_gravity,
                &priors);
  return priors;
}

}  // namespace lazyloc
