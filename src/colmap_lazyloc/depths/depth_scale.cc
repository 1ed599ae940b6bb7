#include "colmap_lazyloc/depths/depth_scale.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {
namespace {

constexpr int kMinNumPoints = 30;
// Maximum standard deviation of the log of depths around a map that is used.
constexpr double kMaxStddev = 0.2;
// Depths of a map of this scene are correlated with those of the points: minimum correlation coefficient, and minimum
// in standard deviations of that of independent depths.
constexpr double kMinCorrelation = 0.3;
constexpr double kMinCorrelationSigma = 3;
constexpr double kMaxDeviation = 3;  // in standard deviations; depths beyond it are outliers
constexpr int kNumCells = 4;         // per side of the image, in which neighbouring errors are compared
// Share of the minimum standard deviation that is common to the whole map, whatever the points say.
constexpr double kMinScaleShare = 0.1;
// Standard deviation, over the minimum, of a metric map that nothing could be compared with.
constexpr double kUntestedRatio = 3;
// Number of independent areas in a metric map that nothing could be compared with.
constexpr double kUntestedNumAreas = 16;

double Square(double x) { return x * x; }

// Returns true if the map's depths grow with those of the points, outliers left out.
bool AreCorrelated(const std::vector<DepthSample>& samples, const DepthFit& fit) {
  std::vector<Eigen::Vector2d> logs;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const DepthSample& sample : samples) {
    const Eigen::Vector2d log(std::log(sample.map_depth), std::log(sample.point_depth));
    if (!(std::abs(log.y() - log.x() - fit.log_scale) <= kMaxDeviation * fit.stddev)) continue;
    logs.push_back(log);
    mean += log;
  }
  mean /= static_cast<double>(logs.size());
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& log : logs) covariance += (log - mean) * (log - mean).transpose();
  const double correlation = covariance(0, 1) / std::sqrt(covariance(0, 0) * covariance(1, 1));
  return correlation > std::max(kMinCorrelation, kMinCorrelationSigma / std::sqrt(static_cast<double>(logs.size())));
}

// Splits the variance of the errors into that of the means of cells and that within cells (analysis of variance, random
// effects).
void SplitVariance(const std::vector<DepthSample>& samples, DepthFit* fit) {
  struct Cell {
    double num = 0, sum = 0, square_sum = 0;
  };
  std::array<Cell, kNumCells * kNumCells> cells;
  const double bound = kMaxDeviation * fit->stddev;
  for (const DepthSample& sample : samples) {
    const double error = std::log(sample.point_depth / sample.map_depth) - fit->log_scale;
    if (!(std::abs(error) <= bound)) continue;
    const auto index = [](double place) { return std::clamp(static_cast<int>(kNumCells * place), 0, kNumCells - 1); };
    Cell& cell = cells[kNumCells * index(sample.place.y()) + index(sample.place.x())];
    cell.num += 1;
    cell.sum += error;
    cell.square_sum += error * error;
  }
  double num = 0, square_num = 0, num_cells = 0, within = 0, between = 0, sum = 0;
  for (const Cell& cell : cells) {
    if (cell.num == 0) continue;
    num += cell.num;
    square_num += cell.num * cell.num;
    num_cells += 1;
    sum += cell.sum;
    within += cell.square_sum - cell.sum * cell.sum / cell.num;
    between += cell.sum * cell.sum / cell.num;
  }
  between -= sum * sum / num;
  fit->pixel_variance = within / std::max(num - num_cells, 1.0);
  if (num_cells < 2) {
    fit->common_variance = fit->pixel_variance;
    return;
  }
  // The mean square between cells exceeds that within them by the cells' variance times this number.
  const double num_per_cell = (num - square_num / num) / (num_cells - 1);
  const double excess = between / (num_cells - 1) - fit->pixel_variance;
  fit->common_variance = std::max(excess, 0.0) / num_per_cell * square_num / (num * num);
}

}  // namespace

DepthFit FitDepthMap(const std::vector<DepthSample>& samples) {
  DepthFit fit;
  fit.num_points = static_cast<int>(samples.size());
  if (fit.num_points < kMinNumPoints) return fit;
  std::vector<double> ratios;
  for (const DepthSample& sample : samples) ratios.push_back(std::log(sample.point_depth / sample.map_depth));
  fit.log_scale = Median(ratios);
  fit.stddev = RobustStddev(std::move(ratios));
  const bool is_informative = fit.stddev <= 2 * kMinDepthStddev || AreCorrelated(samples, fit);
  if (fit.stddev > kMaxStddev || !is_informative) {
    fit.verdict = DepthVerdict::CONTRADICTED;
    return fit;
  }
  fit.verdict = DepthVerdict::USED;
  fit.stddev = std::max(fit.stddev, kMinDepthStddev);
  SplitVariance(samples, &fit);
  fit.pixel_variance = std::max(fit.pixel_variance, Square(kMinDepthStddev));
  fit.scale_variance =
      Square(kMinScaleShare * kMinDepthStddev) + fit.common_variance + fit.pixel_variance / fit.num_points;
  return fit;
}

DepthFit FitMetricDepthMap(const DepthFit& own, const DepthFit& relative) {
  if (own.verdict == DepthVerdict::CONTRADICTED) return own;
  const double metric_variance = Square(kMetricScaleStddev);
  DepthFit fit = own;
  if (own.verdict == DepthVerdict::USED) {
    // A map that points contradict in its scale is not metric, but has the scale that they tell.
    if (Square(own.log_scale) > Square(kMaxDeviation) * (own.scale_variance + metric_variance)) return own;
    fit.log_scale *= metric_variance / (own.scale_variance + metric_variance);
    fit.scale_variance *= metric_variance / (own.scale_variance + metric_variance);
    fit.is_metric = true;
    return fit;
  }
  if (relative.verdict == DepthVerdict::CONTRADICTED) return relative;
  fit = relative;
  if (relative.verdict == DepthVerdict::NO_SCALE) {
    fit.stddev = kUntestedRatio * kMinDepthStddev;
    fit.pixel_variance = Square(fit.stddev);
    fit.common_variance = fit.pixel_variance / kUntestedNumAreas;
  }
  fit.verdict = DepthVerdict::USED;
  fit.is_metric = true;
  fit.log_scale = 0;
  fit.scale_variance = metric_variance + fit.common_variance;
  return fit;
}

}  // namespace lazyloc
