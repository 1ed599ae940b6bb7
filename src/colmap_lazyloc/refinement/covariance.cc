#include "colmap_lazyloc/refinement/covariance.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "colmap_lazyloc/math/robust_statistics.h"

namespace lazyloc {

double VarianceFactor(const PosedImages& posed, const std::vector<Track>& tracks, const RobustLoss& loss) {
  const std::vector<Rigid3d> cams_from_world = CamsFromWorld(posed);
  const auto num_query_frames =
      std::count_if(posed.frames.begin(), posed.frames.end(), [](const Frame& frame) { return !frame.is_database; });
  double squared_sum = 0, weight_sum = 0, num_observations = 0, degrees_of_freedom = 0;
  for (const Track& track : tracks) {
    double track_weight = 0;
    for (const TrackObservation& element : track.observations) {
      const Eigen::Vector2d error_px =
          ReprojectionError(element.observation, cams_from_world[element.image] * track.point_in_world);
      const double squared_error = (ResidualFromPx(posed.images[element.image], track) * error_px).squaredNorm();
      const double weight = loss.Weight(squared_error);
      squared_sum += weight * squared_error;
      track_weight += weight;
    }
    const double num = static_cast<double>(track.observations.size());
    degrees_of_freedom += (2 * num - 3) / num * track_weight;
    weight_sum += track_weight;
    num_observations += num;
  }
  degrees_of_freedom -= 6.0 * static_cast<double>(num_query_frames) * weight_sum / std::max(num_observations, 1.0);
  return squared_sum / std::max(degrees_of_freedom, 1.0);
}

Eigen::Matrix<double, 6, 6> ImageCovariance(const Image& image, bool has_free_scale,
                                            const Eigen::MatrixXd& frame_covariance) {
  if (HasFrameAxes(image)) return frame_covariance.topLeftCorner<6, 6>();
  // x_cam = R x_frame + t rotates the tangent by R.
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(6, frame_covariance.cols());
  const Eigen::Matrix3d rotation = image.cam_from_frame.rotation.toRotationMatrix();
  jacobian.topLeftCorner<3, 3>() = jacobian.block<3, 3>(3, 3) = rotation;
  if (has_free_scale) jacobian.col(6).tail<3>() = image.cam_from_frame.translation;
  return jacobian * frame_covariance * jacobian.transpose();
}

double MedianDistance(const Rigid3d& cam_from_world, const TrackRefs& tracks) {
  std::vector<double> distances;
  for (const Track* track : tracks) distances.push_back((cam_from_world * track->point_in_world).norm());
  return Median(std::move(distances));
}

}  // namespace lazyloc
