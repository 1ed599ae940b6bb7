#include "colmap_lazyloc/pipeline/lazy_localizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <unordered_map>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/bridge/observation.h"
#include "colmap_lazyloc/math/seed.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/report.h"
#include "colmap_lazyloc/pipeline/stage_timer.h"
#include "colmap_lazyloc/pipeline/start_selection.h"
#include "colmap_lazyloc/refinement/covariance.h"
#include "colmap_lazyloc/refinement/view_noise.h"
#include "colmap_lazyloc/structure/track_building.h"
#include "colmap_lazyloc/translation/relative_direction.h"

namespace lazyloc {
namespace {

// Ends the work on a query that cannot be localized.
struct QueryFailure {
  QueryStatus status;
  std::string reason;
};

// A pair on its way through the stages. View i + 1 of the solvers is pair i; view 0 is the query.
struct PairState {
  int index = -1;  // into the problem's pairs
  RelativePose relative_pose;
  ViewMatches view_matches;
  RelativeDirection direction;
};

class QueryLocalizer {
 public:
  QueryLocalizer(const LocalizationProblem& problem, const LocalizerOptions& options)
      : problem_(problem), options_(options), observe_query_(problem.query_camera), views_(problem.pairs.size() + 1) {
    result_.query_name = problem.query_name;
    result_.query_camera = problem.query_camera;
    for (const ImagePair& pair : problem.pairs) {
      constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
      result_.pairs.push_back({pair.database_name, 0, kNone, kNone});
    }
  }

  // The method, stage by stage.
  LocalizationResult Localize() {
    try {
      CheckInput();
      MoveOrigin();
      RunStage("two_view", [&] { FindRelativePoses(); });
      RunStage("rotation", [&] { AverageRotation(); });
      RunStage("directions", [&] { EstimateDirections(); });
      RunStage("translation", [&] { AverageTranslation(); });
      RunStage("tracks", [&] { CollectTracks(); });
      RunStage("start", [&] { ChooseStartPose(); });
      RefineWithTracks();
      RunStage("covariance", [&] { EstimateCovariance(); });
      Report();
      result_.status = QueryStatus::LOCALIZED;
    } catch (const QueryFailure& failure) {
      result_.status = failure.status;
      result_.reason = failure.reason;
    }
    return std::move(result_);
  }

 private:
  template <typename Stage>
  void RunStage(const std::string& name, const Stage& stage) {
    const StageTimer timer(name, &result_.seconds);
    stage();
  }

  void CheckInput() const {
    if (problem_.query_keypoints.empty()) throw QueryFailure{QueryStatus::NO_FEATURES, "the query has no keypoints"};
    if (problem_.pairs.empty()) {
      throw QueryFailure{QueryStatus::NO_PAIRS, "no posed database image shares matches with the query"};
    }
  }

  // All solvers work near zero, wherever the database lies (UTM, ECEF).
  void MoveOrigin() {
    for (const ImagePair& pair : problem_.pairs) origin_ += CamInWorld(pair.database_cam_from_world);
    origin_ /= static_cast<double>(problem_.pairs.size());
    for (size_t i = 0; i < problem_.pairs.size(); ++i) {
      Rigid3d cam_from_world = problem_.pairs[i].database_cam_from_world;
      cam_from_world.rotation.normalize();
      cam_from_world.translation += cam_from_world.rotation * origin_;
      views_[i + 1] = {cam_from_world, /*is_fixed=*/true};
    }
  }

  const View& DatabaseView(const PairState& pair) const { return views_[pair.index + 1]; }

  void FindRelativePoses() {
    for (size_t i = 0; i < problem_.pairs.size(); ++i) {
      const ImagePair& pair = problem_.pairs[i];
      const uint32_t seed = SeedFromNames(problem_.query_name, pair.database_name, options_.seed);
      std::optional<RelativePose> relative_pose = FindRelativePose(problem_, pair, options_.relative_pose, seed);
      if (!relative_pose) continue;
      result_.pairs[i].num_inliers = static_cast<int>(relative_pose->inlier_matches.size());
      pairs_.push_back({static_cast<int>(i), std::move(*relative_pose), {}, {}});
    }
    if (pairs_.empty()) {
      throw QueryFailure{QueryStatus::TOO_FEW_INLIERS,
                         "none of " + std::to_string(problem_.pairs.size()) + " pairs has " +
                             std::to_string(options_.relative_pose.min_num_inliers) + " verified inliers"};
    }
    KeepBestPairs();
  }

  void KeepBestPairs() {
    const size_t max_num_pairs = static_cast<size_t>(options_.max_num_pairs);
    if (max_num_pairs == 0 || pairs_.size() <= max_num_pairs) return;
    const auto has_more_inliers = [](const PairState& a, const PairState& b) {
      return a.relative_pose.inlier_matches.size() > b.relative_pose.inlier_matches.size();
    };
    std::stable_sort(pairs_.begin(), pairs_.end(), has_more_inliers);
    pairs_.resize(max_num_pairs);
    std::sort(pairs_.begin(), pairs_.end(), [](const PairState& a, const PairState& b) { return a.index < b.index; });
  }

  void AverageRotation() {
    RotationAveragingProblem problem;
    problem.rotations.emplace_back(Eigen::Quaterniond::Identity());
    problem.is_fixed.push_back(false);
    for (const PairState& pair : pairs_) {
      problem.edges.push_back({static_cast<int>(problem.rotations.size()), 0,
                               pair.relative_pose.query_from_database.rotation,
                               static_cast<double>(pair.relative_pose.inlier_matches.size())});
      problem.rotations.push_back(DatabaseView(pair).cam_from_world.rotation);
      problem.is_fixed.push_back(true);
    }
    const RotationAveragingResult averaged = AverageRotations(problem, options_.rotation_averaging);
    views_[0].cam_from_world.rotation = averaged.rotations[0];
    KeepAgreeingPairs(averaged.edge_errors_rad);
  }

  void KeepAgreeingPairs(const std::vector<double>& rotation_errors_rad) {
    std::vector<PairState> agreeing;
    size_t num_inliers = 0, num_agreeing_inliers = 0;
    for (size_t i = 0; i < pairs_.size(); ++i) {
      num_inliers += pairs_[i].relative_pose.inlier_matches.size();
      if (rotation_errors_rad[i] > DegToRad(options_.max_rotation_error_deg)) continue;
      num_agreeing_inliers += pairs_[i].relative_pose.inlier_matches.size();
      agreeing.push_back(std::move(pairs_[i]));
    }
    // A lone pair is only believed where the others have little to set against it.
    if (pairs_.size() > 1 && agreeing.size() < 2 && 2 * num_agreeing_inliers <= num_inliers) {
      throw QueryFailure{QueryStatus::INCONSISTENT_ROTATIONS,
                         "no two of " + std::to_string(pairs_.size()) + " pairs agree on the query's rotation within " +
                             std::to_string(options_.max_rotation_error_deg) + " deg"};
    }
    pairs_ = std::move(agreeing);
  }

  void EstimateDirections() {
    for (PairState& pair : pairs_) {
      pair.view_matches = Observed(pair.index, pair.relative_pose.inlier_matches);
      const Eigen::Quaterniond world_from_query = views_[0].cam_from_world.rotation.conjugate();
      const Eigen::Quaterniond world_from_database = DatabaseView(pair).cam_from_world.rotation.conjugate();
      std::vector<RayPair> rays;
      for (size_t i = 0; i < pair.view_matches.matches.size(); ++i) {
        const Observation& database = pair.view_matches.database_observations[i];
        const Observation& query = pair.view_matches.query_observations[i];
        rays.push_back({world_from_database * database.ray_in_cam, world_from_query * query.ray_in_cam,
                        std::hypot(RadFromPx(database), RadFromPx(query)) / std::sqrt(2.0)});
      }
      pair.direction = EstimateRelativeDirection(rays);
    }
  }

  // The matches of a pair whose image points have rays.
  ViewMatches Observed(int pair_index, const Matches& matches) {
    const ImagePair& images = problem_.pairs[pair_index];
    ViewMatches observed;
    observed.view = pair_index + 1;
    const Observer observe_database(images.database_camera);
    for (const Match& match : matches) {
      const auto [query, is_new] = query_observations_.try_emplace(match.query_point);
      if (is_new) query->second = observe_query_(problem_.query_keypoints[match.query_point]);
      const auto database = observe_database(images.database_keypoints[match.database_point]);
      if (query->second && database) observed.Add(match, *query->second, *database);
    }
    return observed;
  }

  void AverageTranslation() {
    TranslationAveragingProblem problem;
    problem.cams_in_world.emplace_back(Eigen::Vector3d::Zero());
    problem.is_fixed.push_back(false);
    for (const PairState& pair : pairs_) {
      // A direction that is not known to half a radian says nothing: the pair has no baseline to speak of.
      if (pair.direction.dir_1to2_in_world.isZero() || pair.direction.stddev_rad > 0.5) continue;
      problem.edges.push_back({static_cast<int>(problem.cams_in_world.size()), 0, pair.direction.dir_1to2_in_world,
                               pair.direction.stddev_rad});
      problem.cams_in_world.push_back(CamInWorld(DatabaseView(pair).cam_from_world));
      problem.is_fixed.push_back(true);
    }
    if (problem.edges.empty()) {
      throw QueryFailure{QueryStatus::DEGENERATE_BASELINE,
                         "the query has no baseline to any of " + std::to_string(pairs_.size()) + " database images"};
    }
    const TranslationAveragingResult averaged = AverageTranslations(problem, options_.translation_averaging);
    if (!averaged.summary.success) throw QueryFailure{QueryStatus::DIVERGED, "translation averaging failed"};
    SetQueryPosition(averaged.cams_in_world[0]);
  }

  void SetQueryPosition(const Eigen::Vector3d& cam_in_world) {
    views_[0].cam_from_world = CamFromWorld(views_[0].cam_from_world.rotation, cam_in_world);
  }

  void CollectTracks() {
    std::vector<ViewMatches> view_matches;
    for (const PairState& pair : pairs_) view_matches.push_back(pair.view_matches);
    candidates_ = BuildTracks(view_matches);
    for (View& view : views_) view.noise_px = options_.start_noise_px;
  }

  void ChooseStartPose() {
    TrackTriangulationOptions without_query = options_.triangulation;
    without_query.max_query_error_sigma = std::numeric_limits<double>::infinity();
    std::vector<Track> tracks = TriangulateTracks(views_, candidates_, without_query);
    const auto needs_query = [](const Track& track) { return track.observations.size() < 3; };
    tracks.erase(std::remove_if(tracks.begin(), tracks.end(), needs_query), tracks.end());
    const double max_error_px = options_.max_start_error_sigma * options_.start_noise_px;
    const uint32_t seed = SeedFromNames(problem_.query_name, "", options_.seed);
    views_[0].cam_from_world = ChooseStart(views_, tracks, max_error_px, seed);
  }

  void RefineWithTracks() {
    TrackTriangulationOptions triangulation = options_.triangulation;
    triangulation.max_query_error_sigma = options_.max_start_error_sigma;
    for (int round = 0; round < options_.num_refinement_rounds; ++round) {
      RunStage("triangulation", [&] { Triangulate(triangulation); });
      RunStage("adjustment", [&] { Adjust(); });
      if (round + 1 == options_.num_refinement_rounds) break;
      EstimateViewNoise(tracks_, options_.min_noise_px, &views_);
      triangulation.max_query_error_sigma = options_.triangulation.max_query_error_sigma;
    }
    tracks_ = FittingTracks(views_, tracks_, options_.triangulation.max_query_error_sigma);
  }

  void Triangulate(const TrackTriangulationOptions& triangulation) {
    tracks_ = TriangulateTracks(views_, candidates_, triangulation);
    if (static_cast<int>(tracks_.size()) < options_.min_num_tracks) {
      throw QueryFailure{QueryStatus::TOO_FEW_TRACKS,
                         std::to_string(tracks_.size()) + " of " + std::to_string(candidates_.size()) +
                             " tracks can be triangulated; " + std::to_string(options_.min_num_tracks) + " are needed"};
    }
  }

  void Adjust() {
    const StageSummary summary = AdjustBundle(options_.bundle_adjustment, &views_, &tracks_);
    const Rigid3d& pose = views_[0].cam_from_world;
    if (!summary.success || !pose.rotation.coeffs().allFinite() || !pose.translation.allFinite()) {
      throw QueryFailure{QueryStatus::DIVERGED, "bundle adjustment failed: " + summary.message};
    }
  }

  void EstimateCovariance() {
    if (static_cast<int>(tracks_.size()) < options_.min_num_tracks) {
      throw QueryFailure{QueryStatus::TOO_FEW_TRACKS, "only " + std::to_string(tracks_.size()) +
                                                          " tracks agree with the refined pose; " +
                                                          std::to_string(options_.min_num_tracks) + " are needed"};
    }
    const double scale = options_.bundle_adjustment.loss_scale_sigma;
    Eigen::Matrix<double, 6, 6> information = PoseInformation(views_, tracks_, 0, scale);
    CheckObservability(information);
    // Into the tangent of the pose in the database's own frame: t = t_local - R origin.
    Eigen::Matrix<double, 6, 6> world_from_local = Eigen::Matrix<double, 6, 6>::Identity();
    world_from_local.bottomLeftCorner<3, 3>() = Hat(views_[0].cam_from_world.rotation * origin_);
    const Eigen::Matrix<double, 6, 6> covariance =
        VarianceFactor(views_, tracks_, scale) * information.ldlt().solve(Eigen::Matrix<double, 6, 6>::Identity());
    const Eigen::Matrix<double, 6, 6> moved = world_from_local * covariance * world_from_local.transpose();
    result_.covariance = (moved + moved.transpose()) / 2;
  }

  // The image noise must not leave the position open.
  void CheckObservability(const Eigen::Matrix<double, 6, 6>& information) const {
    const double stddev_ratio = RelativePoseStddev(information, MedianDistance(views_[0], tracks_));
    if (stddev_ratio <= options_.max_position_stddev_ratio) return;
    if (NumDistinctCentres() == 1) {
      throw QueryFailure{QueryStatus::SCALE_UNOBSERVABLE,
                         "only one database position is usable: the distance to it cannot be known"};
    }
    throw QueryFailure{QueryStatus::DEGENERATE_BASELINE,
                       "the position is open along a line: no point is seen from two database images apart"};
  }

  int NumDistinctCentres() const {
    std::vector<Eigen::Vector3d> centres;
    for (const PairState& pair : pairs_) {
      const Eigen::Vector3d centre = CamInWorld(DatabaseView(pair).cam_from_world);
      const bool is_new = std::none_of(centres.begin(), centres.end(), [&](const Eigen::Vector3d& other) {
        return (centre - other).norm() <= 1e-9 * (1 + centre.norm());
      });
      if (is_new) centres.push_back(centre);
    }
    return static_cast<int>(centres.size());
  }

  void Report() {
    const Rigid3d& pose = views_[0].cam_from_world;
    result_.cam_from_world = {pose.rotation, pose.translation - pose.rotation * origin_};
    ReportPairs();
    ReportTracks(views_, tracks_, origin_, &result_);
  }

  void ReportPairs() {
    const Rigid3d& query = views_[0].cam_from_world;
    for (const PairState& pair : pairs_) {
      const Rigid3d& database = DatabaseView(pair).cam_from_world;
      PairResult& report = result_.pairs[pair.index];
      report.rotation_error_deg = RadToDeg(
          AngularDistanceRad(query.rotation, pair.relative_pose.query_from_database.rotation * database.rotation));
      if (pair.direction.dir_1to2_in_world.isZero()) continue;
      report.direction_error_deg =
          RadToDeg(AngleBetweenRad(pair.direction.dir_1to2_in_world, CamInWorld(query) - CamInWorld(database)));
    }
  }

  const LocalizationProblem& problem_;
  const LocalizerOptions& options_;
  const Observer observe_query_;
  std::unordered_map<uint32_t, std::optional<Observation>> query_observations_;  // by keypoint; as far as needed
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  std::vector<View> views_;
  std::vector<PairState> pairs_;   // those still in use
  std::vector<Track> candidates_;  // all tracks, points not set
  std::vector<Track> tracks_;      // those that hold
  LocalizationResult result_;
};

}  // namespace

LocalizationResult LocalizeQuery(const LocalizationProblem& problem, const LocalizerOptions& options) {
  return QueryLocalizer(problem, options).Localize();
}

}  // namespace lazyloc
