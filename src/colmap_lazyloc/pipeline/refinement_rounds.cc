#include "colmap_lazyloc/pipeline/refinement_rounds.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "colmap_lazyloc/group/failure.h"
#include "colmap_lazyloc/group/rig_check.h"
#include "colmap_lazyloc/math/robust_statistics.h"
#include "colmap_lazyloc/noise/database_priors.h"
#include "colmap_lazyloc/noise/image_noise.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

constexpr int kMaxNumEstimates = 8;
// Factor on the convergence bound of all adjustments but the last, because another one follows.
constexpr double kIntermediateConvergence = 5;
// Image noise in pixels above which database poses must be off, because no keypoint is found this badly.
constexpr double kMaxKeypointNoisePx = 5;
// Minimum variance factor by which depths are stated less certain beside images that count as too uncertain.
constexpr double kMinDepthVarianceFactor = 1e-6;

// The state of the rounds, of which each step replaces a part.
class Rounds {
 public:
  Rounds(const Layout& layout, const PosedImages& start, const LocalizerOptions& options,
         std::optional<QueryCamera> camera)
      : layout_(layout), options_(options), camera_(std::move(camera)), priors_(layout, options) {
    adjustment_.posed = start;
    for (const Image& image : start.images) depth_scales_.push_back(image.depth_scale);
  }

  const PosedImages& Posed() const { return adjustment_.posed; }

  // Keeps the tracks from the database that fit the query, and triangulates the others with it.
  void SetTracks(SplitTracks split, double max_query_error_sigma) {
    TrackTriangulationOptions options = options_.triangulation;
    options.max_query_error_sigma = max_query_error_sigma;
    const size_t num_candidates = split.from_database.size() + split.rest.size();
    adjustment_.tracks = RemoveQueryOutliers(Posed(), std::move(split.from_database), max_query_error_sigma);
    for (Track& track : TriangulateWithQuery(Posed(), std::move(split.rest), options)) {
      adjustment_.tracks.push_back(std::move(track));
    }
    const std::vector<TrackRefs> tracks_of = TracksByFrame(layout_, adjustment_.tracks);
    CheckFrames(layout_.num_query_frames, QueryStatus::TOO_FEW_TRACKS, [&](int frame) {
      if (static_cast<int>(tracks_of[frame].size()) >= kMinNumTracks) return Reason();
      return Reason(std::to_string(tracks_of[frame].size()) + " of " + std::to_string(num_candidates) +
                    " tracks can be triangulated; " + std::to_string(kMinNumTracks) + " are needed");
    });
  }

  // Adjusts without priors, because errors of a rough start would be taken for errors of the database.
  void AdjustRoughly() {
    SetDepthScales(kStartNoisePx);
    Adjust(/*is_last=*/false);
  }

  void AdjustWithPriors(bool is_last) {
    const std::vector<FrameScale> scales = MeasureFrameScales(Posed(), adjustment_.tracks);
    priors_.Set(scales, &adjustment_.posed);
    const double rig_noise_px = options_.rig_noise_px / std::sqrt(priors_.ImageVarianceFactor());
    SetCalibrationPriors(layout_, scales, rig_noise_px, &adjustment_.posed);
    SetDepthScales(1 / std::sqrt(std::clamp(variance_factor_, kMinDepthVarianceFactor, 1.0)));
    Adjust(is_last);
  }

  // Adjusts under priors and estimates their size from the result; again while the estimate changes, if it is large.
  void AdjustWithEstimatedPriors() {
    for (int i = 0;; ++i) {
      AdjustWithPriors(/*is_last=*/false);
      variance_factor_ =
          VarianceFactor(Posed(), adjustment_.tracks, RobustLoss(options_.bundle_adjustment.loss_scale_sigma));
      const double change = priors_.Estimate(adjustment_, variance_factor_);
      if (!poses_are_far_off_ || change < 0.1 || i + 1 >= kMaxNumEstimates) return;
      EstimateNoise(/*is_first=*/false);
    }
  }

  // Estimates the image noise, after the first round also what the priors are expected to be.
  void EstimateNoise(bool is_first) {
    const std::vector<double> noise_px = EstimateImageNoise(Posed(), adjustment_.tracks, kMinImageNoisePx);
    for (size_t image = 0; image < noise_px.size(); ++image) adjustment_.posed.images[image].noise_px = noise_px[image];
    if (!is_first) return;
    // If the images fit together so badly that keypoint noise cannot be the reason, the estimate of the database's
    // noise starts from all of it, because it converges in a few steps downwards and hardly moves upwards.
    const double median_px = Median({noise_px.begin() + layout_.num_queries, noise_px.end()});
    poses_are_far_off_ = median_px > kMaxKeypointNoisePx;
    if (poses_are_far_off_) priors_.Expect(median_px);
  }

  const std::optional<QueryCamera>& RefinedCamera() const { return camera_; }

  BundleAdjustmentResult Finish() && {
    adjustment_.tracks =
        RemoveOutliers(Posed(), std::move(adjustment_.tracks), options_.triangulation.max_query_error_sigma);
    return std::move(adjustment_);
  }

 private:
  void Adjust(bool is_last) {
    BundleAdjustmentOptions options = options_.bundle_adjustment;
    options.computes_covariances = is_last;
    if (!is_last) options.convergence_sigma *= kIntermediateConvergence;
    adjustment_ = camera_ ? camera_->Adjust(Posed(), std::move(adjustment_.tracks), options)
                          : AdjustBundle(Posed(), std::move(adjustment_.tracks), options);
    const bool is_finite = std::all_of(Posed().frames.begin(), Posed().frames.end(), [](const Frame& frame) {
      const Rigid3d& pose = frame.frame_from_world;
      return frame.is_database || (pose.rotation.coeffs().allFinite() && pose.translation.allFinite());
    });
    if (!adjustment_.summary.success || !is_finite) {
      throw Failure{QueryStatus::DIVERGED, "bundle adjustment failed: " + adjustment_.summary.message};
    }
  }

  // States the uncertainty of the depth maps for images that adjustment takes for uncertain by this factor too much.
  void SetDepthScales(double noise_factor) {
    for (size_t i = 0; i < depth_scales_.size(); ++i) {
      std::optional<DepthScale>& scale = adjustment_.posed.images[i].depth_scale;
      if (!scale) continue;
      scale->log_scale_stddev = noise_factor * depth_scales_[i]->log_scale_stddev;
      scale->log_depth_stddev = noise_factor * depth_scales_[i]->log_depth_stddev;
    }
  }

  const Layout& layout_;
  const LocalizerOptions& options_;
  std::optional<QueryCamera> camera_;
  BundleAdjustmentResult adjustment_;
  DatabasePriors priors_;
  std::vector<std::optional<DepthScale>> depth_scales_;  // by image, as fitted before the rounds
  bool poses_are_far_off_ = false;                       // of the database, by far more than keypoint noise
  double variance_factor_ = 1;                           // of the adjustment before the last one
};

}  // namespace

Refined Refine(const Layout& layout, const PosedImages& start, const SplitTracks& start_tracks,
               CandidateTracks candidates, const LocalizerOptions& options, StageTimer::Seconds* seconds,
               std::optional<QueryCamera> camera) {
  Refined refined;
  Rounds rounds(layout, start, options, std::move(camera));
  const double max_query_error_sigma = options.triangulation.max_query_error_sigma;
  const auto triangulate = [&](std::vector<Track> tracks) {
    return TriangulateFromDatabase(rounds.Posed(), std::move(tracks), options.triangulation);
  };
  const auto estimate_noise = [&](bool is_first) {
    if (const std::optional<QueryCamera>& now = rounds.RefinedCamera()) {
      candidates = {now->Observe(candidates.all), now->Observe(candidates.for_start)};
    }
    rounds.EstimateNoise(is_first);
  };
  // The first round is from a rough start, the second estimates noise and priors, and the last has these.
  Timed("triangulation", seconds, [&] { rounds.SetTracks(start_tracks, kMaxStartErrorSigma); });
  Timed("adjustment", seconds, [&] {
    rounds.AdjustRoughly();
    estimate_noise(/*is_first=*/true);
  });
  Timed("triangulation", seconds, [&] { rounds.SetTracks(triangulate(candidates.for_start), max_query_error_sigma); });
  Timed("adjustment", seconds, [&] {
    rounds.AdjustWithEstimatedPriors();
    estimate_noise(/*is_first=*/false);
  });
  Timed("triangulation", seconds, [&] {
    SplitTracks split = triangulate(std::move(candidates.all));
    refined.rig_errors_px = CheckRigs(layout, rounds.Posed(), split.from_database, options);
    rounds.SetTracks(std::move(split), max_query_error_sigma);
  });
  Timed("adjustment", seconds, [&] { rounds.AdjustWithPriors(/*is_last=*/true); });
  refined.camera = rounds.RefinedCamera();
  refined.adjustment = std::move(rounds).Finish();
  refined.variance_factor = VarianceFactor(refined.adjustment.posed, refined.adjustment.tracks,
                                           RobustLoss(options.bundle_adjustment.loss_scale_sigma));
  refined.SetMissingVariances();
  return refined;
}

}  // namespace lazyloc
