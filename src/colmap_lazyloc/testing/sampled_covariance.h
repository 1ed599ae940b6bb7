#pragma once

#include <vector>

#include <gtest/gtest.h>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/refinement/bundle_adjustment.h"
#include "colmap_lazyloc/testing/synthetic_tracks.h"

namespace lazyloc {

// Adjusts exact tracks with keypoint noise of one pixel, drawn anew in each trial. Returns the sample covariances of
// the images' cam_from_world in its tangent.
inline std::vector<Eigen::Matrix<double, 6, 6>> SampleCovariances(const SyntheticTracks& truth, double focal_length_px,
                                                                  const BundleAdjustmentOptions& options,
                                                                  int num_trials) {
  const std::vector<Rigid3d> exact = CamsFromWorld(truth.posed);
  std::vector<Eigen::Matrix<double, 6, 6>> covariances(exact.size(), Eigen::Matrix<double, 6, 6>::Zero());
  Random random(3);
  for (int trial = 0; trial < num_trials; ++trial) {
    std::vector<Track> tracks = truth.tracks;
    for (Track& track : tracks) {
      for (TrackObservation& element : track.observations) {
        element.observation =
            ObserveAt(exact[element.image] * track.point_in_world, focal_length_px, RandomVector(&random).head<2>());
      }
    }
    const BundleAdjustmentResult result = AdjustBundle(truth.posed, tracks, options);
    EXPECT_TRUE(result.summary.success);
    const std::vector<Rigid3d> adjusted = CamsFromWorld(result.posed);
    for (size_t i = 0; i < exact.size(); ++i) {
      Eigen::Matrix<double, 6, 1> error;
      error << LogSO3(adjusted[i].rotation * exact[i].rotation.conjugate()),
          adjusted[i].translation - exact[i].translation;
      covariances[i] += error * error.transpose() / num_trials;
    }
  }
  return covariances;
}

}  // namespace lazyloc
