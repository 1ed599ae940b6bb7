#include "colmap_lazyloc/noise/viewpoint_errors.h"

#include <algorithm>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/noise/database_priors.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/refinement/prior_precision.h"

namespace lazyloc {
namespace {

void MoveFrame(const PosedImages& adjusted, const PriorGroup& group, int query_frame, const std::vector<int>& images,
               PosedImages* reported) {
  const Rigid3d& frame_from_world = adjusted.frames[query_frame].frame_from_world;
  const PosePrior& unit = *adjusted.frames[group.frames.front()].prior;  // its standard deviations are common to all
  std::vector<Rigid3d> viewpoints;
  for (const int image : images) viewpoints.push_back(CamFromWorld(adjusted, image));
  const Eigen::MatrixXd deviations = MeasureDeviations(adjusted, group);
  Eigen::MatrixXd errors(images.size(), 6);
  const PredictedErrors predicted = PredictErrors(adjusted, group, frame_from_world, viewpoints);
  errors << predicted.by_rotation * deviations.leftCols<3>(), predicted.by_position * deviations.rightCols<3>();
  for (size_t i = 0; i < images.size(); ++i) {
    const Eigen::Matrix<double, 6, 1> error = errors.row(static_cast<Eigen::Index>(i));
    const Rigid3d& pose = viewpoints[i];
    const Rigid3d moved =
        CamFromWorld((pose.rotation * ExpSO3(-unit.rotation_stddev_rad * error.head<3>())).normalized(),
                     CamInWorld(pose) - unit.position_stddev * error.tail<3>());
    reported->images[images[i]].cam_from_frame = moved * Inverse(frame_from_world);
  }
}

}  // namespace

Eigen::MatrixXd MeasureDeviations(const PosedImages& adjusted, const PriorGroup& group) {
  Eigen::MatrixXd deviations(group.frames.size(), 6);
  for (size_t i = 0; i < group.frames.size(); ++i) {
    const Frame& frame = adjusted.frames[group.frames[i]];
    deviations.row(static_cast<Eigen::Index>(i)) = EvaluatePosePrior(*frame.prior, frame.frame_from_world).error;
  }
  return deviations;
}

PredictedErrors PredictErrors(const PosedImages& adjusted, const PriorGroup& group, const Rigid3d& first,
                              const std::vector<Rigid3d>& viewpoints) {
  const auto size = static_cast<Eigen::Index>(group.frames.size());
  const auto num_viewpoints = static_cast<Eigen::Index>(viewpoints.size());
  const PosePrior& unit = *adjusted.frames[group.frames.front()].prior;  // its standard deviations are common to all
  std::vector<Rigid3d> poses;
  for (const int frame : group.frames) poses.push_back(adjusted.frames[frame].prior->frame_from_world);
  poses.insert(poses.end(), viewpoints.begin(), viewpoints.end());
  // Relate the errors at the viewpoints to those of the corrected frames. Only the part that changes with the
  // viewpoint is common to both.
  const Eigen::MatrixXd shape =
      group.components[0].variance * ViewpointErrorShape(poses, first, unit.position_stddev / unit.rotation_stddev_rad);
  const Eigen::MatrixXd shared = shape.bottomLeftCorner(num_viewpoints, size);
  const PriorPrecision precision = ComputePriorPrecision(group);
  PredictedErrors predicted{shared * precision.rotation, shared * precision.position, {}, {}};
  const Eigen::VectorXd variances = shape.diagonal().tail(num_viewpoints);
  predicted.rotation_variances = variances - predicted.by_rotation.cwiseProduct(shared).rowwise().sum();
  predicted.position_variances = variances - predicted.by_position.cwiseProduct(shared).rowwise().sum();
  return predicted;
}

PosedImages RelativeToGivenDatabase(const Layout& layout, const PosedImages& adjusted) {
  PosedImages reported = adjusted;
  for (size_t i = 0; i < adjusted.prior_groups.size(); ++i) {  // one per query frame
    const PriorGroup& group = adjusted.prior_groups[i];
    if (group.frames.empty() || group.HasStatedSizes()) continue;  // stated errors are independent
    std::vector<int> images;
    for (const int image : layout.QueriesOf(static_cast<int>(i))) {
      const int calibration = adjusted.images[image].calibration;
      const bool is_stated = calibration >= 0 && adjusted.calibrations[calibration].is_stated_by_database;
      if (image != layout.QueriesOf(static_cast<int>(i)).front() && !is_stated) images.push_back(image);
    }
    if (!images.empty()) MoveFrame(adjusted, group, static_cast<int>(i), images, &reported);
  }
  std::copy(layout.given.frames.begin() + layout.num_query_frames, layout.given.frames.end(),
            reported.frames.begin() + layout.num_query_frames);
  for (size_t i = 0; i < reported.images.size(); ++i) {
    const Image& given = layout.given.images[i];
    if (given.calibration < 0 || !layout.given.calibrations[given.calibration].is_stated_by_database) continue;
    reported.images[i].cam_from_frame = given.cam_from_frame;
  }
  return reported;
}

}  // namespace lazyloc
