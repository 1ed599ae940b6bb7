#include "colmap_lazyloc/pipeline/post_optimization.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "colmap_lazyloc/math/median.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/rig_check.h"
#include "colmap_lazyloc/pipeline/track_collection.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/pose_prior.h"
#include "colmap_lazyloc/refinement/view_noise.h"
#include "colmap_lazyloc/scene/stage_timer.h"

namespace lazyloc {
namespace {

constexpr int kMaxNumEstimates = 8;
// No keypoint is found this badly: poses of the database must be off.
constexpr double kLoudNoisePx = 6;

void AddQueries(double max_query_error_sigma, double single_view_spread, QueryState* state) {
  TrackTriangulationOptions options = state->options.triangulation;
  // By the variances' ratio: wrong matches do not only scatter, they also agree with the relative pose that chose them.
  options.single_view_noise_ratio *= single_view_spread;
  options.max_query_error_sigma = max_query_error_sigma;
  const size_t num_candidates = state->tracks_from_database.size() + state->tracks_with_query.size();
  state->tracks = TracksFittingQuery(state->views, std::move(state->tracks_from_database), max_query_error_sigma);
  for (Track& track : TriangulateWithQuery(state->views, std::move(state->tracks_with_query), options)) {
    state->tracks.push_back(std::move(track));
  }
  const std::vector<int> num_tracks = state->NumTracksByFrame(state->tracks);
  CheckFrames(*state, QueryStatus::TOO_FEW_TRACKS, [&](int frame) -> std::optional<std::string> {
    if (num_tracks[frame] >= state->options.min_num_tracks) return std::nullopt;
    return std::to_string(num_tracks[frame]) + " of " + std::to_string(num_candidates) +
           " tracks can be triangulated; " + std::to_string(state->options.min_num_tracks) + " are needed";
  });
}

// Priors as the options state them, and of noise_px where they do not.
void SetPriors(double noise_px, const std::vector<ViewScale>& scales, QueryState* state) {
  const double stddev_rad = DegToRad(state->options.database_pose_stddev_deg);
  const double stddev_length = state->options.database_pose_stddev_length;
  if (stddev_rad == 0 && stddev_length == 0) return;
  for (size_t view = state->NumQueries(); view < state->views.size(); ++view) {
    state->views[view].prior.reset();
    if (scales[view].distance == 0) continue;  // no track reaches it
    PosePrior prior = MakePosePrior(state->GivenPose(view), noise_px, scales[view]);
    // A zero beside a value that is none: as good as exact.
    const PosePrior smallest = MakePosePrior(state->GivenPose(view), 1e-3, scales[view]);
    if (stddev_rad >= 0) prior.rotation_stddev_rad = std::max(stddev_rad, smallest.rotation_stddev_rad);
    if (stddev_length >= 0) prior.position_stddev = std::max(stddev_length, smallest.position_stddev);
    state->views[view].prior = prior;
  }
}

void Adjust(bool is_last, QueryState* state) {
  BundleAdjustmentOptions options = state->options.bundle_adjustment;
  options.fits_priors = is_last;  // for the covariance
  state->adjustment = AdjustBundle(options, &state->views, &state->tracks);
  const bool is_finite = std::all_of(state->frames.begin(), state->frames.end(), [&](int frame) {
    const Rigid3d& pose = state->views[frame].cam_from_world;
    return pose.rotation.coeffs().allFinite() && pose.translation.allFinite();
  });
  if (!state->adjustment.summary.success || !is_finite) {
    throw QueryFailure{QueryStatus::DIVERGED, "bundle adjustment failed: " + state->adjustment.summary.message};
  }
  if (!state->SeeksFocalLength()) return;
  state->ScaleFocalLength(std::exp(*state->views[0].log_focal_factor));
  state->views[0].log_focal_factor = 0;
}

// What the database's pose noise is taken for before it is estimated. Where the images fit together so badly that
// keypoint noise cannot be the reason, the estimate starts from all of that: downwards it converges in a few steps,
// upwards it hardly moves.
double ExpectedDatabaseNoisePx(const QueryState& state) {
  std::vector<double> noise_px;
  for (size_t view = state.NumQueries(); view < state.views.size(); ++view)
    noise_px.push_back(state.views[view].noise_px);
  const double median_px = Median(std::move(noise_px));
  return median_px > kLoudNoisePx ? median_px : state.options.database_pose_noise_px;
}

// Adjusts under priors of noise_px.
std::vector<ViewScale> AdjustWithPriors(double noise_px, bool is_last, QueryState* state) {
  std::vector<ViewScale> scales = MeasureViewScales(state->views, state->tracks);
  SetPriors(noise_px, scales, state);
  Adjust(is_last, state);
  return scales;
}

// Adjusts under priors and estimates their size from the outcome; again while it changes, if it is loud.
double EstimatePriors(double noise_px, QueryState* state) {
  const LocalizerOptions& options = state->options;
  const bool is_stated = options.database_pose_stddev_deg >= 0 && options.database_pose_stddev_length >= 0;
  const bool is_loud = !is_stated && noise_px > options.database_pose_noise_px;
  for (int i = 0;; ++i) {
    const std::vector<ViewScale> scales = AdjustWithPriors(noise_px, /*is_last=*/false, state);
    const double variance_factor =
        VarianceFactor(state->views, state->tracks, options.bundle_adjustment.loss_scale_sigma);
    const double estimate_px = EstimateDatabasePoseNoise(state->views, scales, state->adjustment.pose_covariances,
                                                         variance_factor, options.database_pose_noise_px);
    const bool is_settled = !is_loud || std::abs(std::log(estimate_px / noise_px)) < 0.1;
    noise_px = estimate_px;
    if (is_settled || i + 1 >= kMaxNumEstimates) return noise_px;
    EstimateViewNoise(state->tracks, options.min_noise_px, &state->views);
  }
}

}  // namespace

void OptimizeOverTracks(QueryState* state) {
  const LocalizerOptions& options = state->options;
  double max_query_error_sigma = options.max_start_error_sigma;
  double database_noise_px = options.database_pose_noise_px;
  double single_view_spread = 1;
  for (int round = 0;; ++round) {
    const bool is_last = round + 1 == options.num_refinement_rounds;
    {
      const StageTimer timer("triangulation", &state->seconds);
      // The first round's tracks were triangulated for the start.
      if (round > 0) {
        state->tracks_from_database =
            TriangulateFromDatabase(state->views, is_last ? std::move(state->candidates) : state->start_candidates,
                                    options.triangulation, &state->tracks_with_query);
      }
      if (is_last) CheckRigs(state);
      AddQueries(max_query_error_sigma, single_view_spread, state);
    }
    const StageTimer timer("adjustment", &state->seconds);
    if (round == 0) {
      // The start is rough: its errors would be taken for errors of the database.
      Adjust(is_last, state);
    } else if (is_last) {
      AdjustWithPriors(database_noise_px, is_last, state);
    } else {
      database_noise_px = EstimatePriors(database_noise_px, state);
    }
    if (is_last) break;
    EstimateViewNoise(state->tracks, options.min_noise_px, &state->views);
    if (round == 0) {
      database_noise_px = ExpectedDatabaseNoisePx(*state);
      single_view_spread = MeasureSingleViewSpread(state->tracks, state->views);
    }
    max_query_error_sigma = options.triangulation.max_query_error_sigma;
  }
  state->tracks = FittingTracks(state->views, std::move(state->tracks), options.triangulation.max_query_error_sigma);
}

}  // namespace lazyloc
