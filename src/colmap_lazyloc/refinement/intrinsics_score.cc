#include "colmap_lazyloc/refinement/intrinsics_score.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include "colmap_lazyloc/math/cluster_covariance.h"
#include "colmap_lazyloc/refinement/bundle_solver.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

// Share of the information with points and poses fixed that always remains, because that of an unobservable correction
// would else be a rounding error.
constexpr double kRegularization = 1e-9;

// How often what common errors add to the squares of the patterns counts once more: more of them look like corrections.
constexpr double kExcessWeight = 4;

// Number of clusters that a pose uses up: half of its unknowns, because the errors that a cluster shares are
// displacements in two coordinates.
constexpr int kNumClusterParameters = 3;

// Foreign patterns: displacements of the image that neither a pose nor a correction makes. With those that these make,
// they are all displacements of first and second degree in the image coordinates.
constexpr int kNumPatterns = 5;

// The corrections, and after them the patterns.
constexpr int kNumColumns = NUM_INTRINSICS_PARAMETERS + kNumPatterns;

using Derivative = Eigen::Matrix<double, 2, kNumColumns>;
using Information = Eigen::Matrix<double, kNumColumns, kNumColumns>;

// Returns the derivative of a point's projection with respect to the corrections and the patterns. offset: of the
// projection from the principal point.
Derivative ProjectionDerivative(const Eigen::Vector2d& offset) {
  Derivative derivative;
  derivative.leftCols<NUM_INTRINSICS_PARAMETERS>() = CorrectionDerivative(offset);
  const double x = offset.x() / kRadialUnitPx, y = offset.y() / kRadialUnitPx;
  derivative.rightCols<kNumPatterns>() << y, x * x, y * y, 0, 0, x, 0, 0, x * x, y * y;
  return derivative;
}

// The equations of a query frame, over the frames that observe common points with it.
template <int kSize>
class ScoreBuilder {
  using Coupling = Eigen::Matrix<double, kSize, kNumColumns>;
  using FrameColumns = Eigen::Matrix<double, Eigen::Dynamic, kSize>;
  using Moves = Eigen::Matrix<double, Eigen::Dynamic, kNumColumns>;
  using ByPoint = Eigen::Matrix<double, kNumColumns, 3>;
  using Pattern = Eigen::Matrix<double, kNumPatterns, 1>;
  using PatternMatrix = Eigen::Matrix<double, kNumPatterns, kNumPatterns>;
  using PatternFromColumns = Eigen::Matrix<double, kNumPatterns, kNumColumns>;

 public:
  // frame: of `posed`.
  ScoreBuilder(const BundleSolver<kSize>& solver, const PosedImages& posed, const std::vector<Track>& tracks,
               const RobustLoss& loss, int frame)
      : solver_(solver),
        posed_(posed),
        tracks_(tracks),
        loss_(loss),
        frame_(solver.Problem().index_of_frame[frame]),
        is_query_pose_(solver.Problem().frames.size(), false),
        place_of_frame_(solver.Problem().frames.size(), -1) {
    const BundleProblem& problem = solver_.Problem();
    for (size_t image = 0; image < posed_.images.size(); ++image) {
      if (posed_.images[image].frame == frame) is_query_pose_[problem.index_of_image[image]] = true;
    }
    CouplingWith(frame_);
    if (!solver_.Cameras().IsDense()) return;
    for (size_t i = 0; i < problem.frames.size(); ++i) CouplingWith(static_cast<int>(i));
  }

  // Adds a track that the frame observes.
  void AddTrack(size_t track) {
    const BundleProblem& problem = solver_.Problem();
    const BundleState& state = solver_.Linearization();
    const Range& range = problem.free_range[track];
    ByPoint by_point = ByPoint::Zero();
    for (size_t i = range.begin; i < range.end; ++i) {
      const int frame = problem.free[i].frame;
      if (!is_query_pose_[frame]) continue;
      BundleError error;
      const double root_weight = Evaluate(track, problem.free[i], &error);
      if (root_weight == 0) continue;
      const Derivative derivative = NormalisedDerivative(track, problem.free[i], root_weight, error);
      const Information information = derivative.transpose() * derivative;
      information_ += information;
      information_.diagonal() += kRegularization * information.diagonal();
      score_of_columns_ -= derivative.transpose() * error.error;
      CouplingWith(frame) += error.ByFrame<kSize>() * derivative;
      by_point += derivative.transpose() * error.ByPointInWorld(state.frames[frame]);
    }
    const auto& equations = solver_.Equations();
    const ByPoint eliminated = by_point * equations.point_factors[track].inverse.transpose();
    information_ -= eliminated * eliminated.transpose();
    score_of_columns_ += eliminated * equations.point_factors[track].gradient;
    for (size_t i = range.begin; i < range.end; ++i) {
      CouplingWith(problem.free[i].frame) -= equations.eliminated[i] * eliminated.transpose();
    }
  }

  // Eliminates the poses and returns the score of the frame. tracks: those that were added.
  IntrinsicsScore Finish(const std::vector<size_t>& tracks) {
    const Eigen::LLT<Eigen::MatrixXd> factor(solver_.Cameras().EquationsOf(places_, solver_.Equations().reduced));
    Moves coupling(kSize * places_.size(), static_cast<Eigen::Index>(kNumColumns));
    Eigen::VectorXd rhs(coupling.rows());
    for (size_t i = 0; i < places_.size(); ++i) {
      coupling.template middleRows<kSize>(kSize * i) = couplings_[i];
      rhs.segment<kSize>(kSize * i) = solver_.Equations().rhs.template segment<kSize>(kSize * places_[i]);
    }
    const Moves poses_from_correction = -factor.solve(coupling);
    information_ += coupling.transpose() * poses_from_correction;
    score_of_columns_ += poses_from_correction.transpose() * rhs;
    constexpr int kNum = NUM_INTRINSICS_PARAMETERS;
    score_.information = information_.template topLeftCorner<kNum, kNum>();
    score_.score = score_of_columns_.template head<kNum>();
    score_.frame_from_correction = poses_from_correction.template topLeftCorner<6, kNum>();
    if (kSize > 6) score_.log_factor_from_correction = poses_from_correction.row(kSize - 1).template head<kNum>();
    const FrameColumns columns =
        factor.solve(Eigen::MatrixXd::Identity(factor.rows(), factor.rows()).leftCols<kSize>());
    SetSharedErrors(columns, poses_from_correction, tracks);
    if (IsFocalLengthEstimated()) SetEstimatedFocalLength(columns.col(kSize - 1));
    return std::move(score_);
  }

 private:
  bool IsFocalLengthEstimated() const {
    return solver_.Problem().frames[frame_].kind == BlockKind::POSE_AND_FOCAL_LENGTH;
  }

  Coupling& CouplingWith(int frame) {
    int& place = place_of_frame_[frame];
    if (place < 0) {
      place = static_cast<int>(places_.size());
      places_.push_back(frame);
      couplings_.push_back(Coupling::Zero());
    }
    return couplings_[place];
  }

  // Evaluates the weighted error of an observation. Returns the root of its weight; 0 if the point lies behind the
  // camera.
  double Evaluate(size_t track, const FreeObservation& observation, BundleError* error) const {
    const BundleState& state = solver_.Linearization();
    if (!error->Evaluate(observation, state.frames[observation.frame], state.points[track])) return 0;
    const double root_weight = std::sqrt(loss_.Weight(error->error.squaredNorm()));
    error->Scale(root_weight);
    return root_weight;
  }

  // Returns the weighted derivative of a weighted error with respect to the corrections, where the point is seen: that
  // of the keypoint lacks the error, and the sum of these products is no longer small beside a weak score.
  Derivative NormalisedDerivative(size_t track, const FreeObservation& observation, double root_weight,
                                  const BundleError& error) const {
    const TrackObservation& element = tracks_[track].observations[observation.element];
    const Image& image = posed_.images[element.image];
    const double from_px = root_weight * ResidualFromPx(image, tracks_[track]);
    Eigen::Vector2d offset = element.observation.px_from_log_focal;
    if (!image.log_focal_factor) offset += error.error / from_px;  // else that of the projection (QueryCamera::Adjust)
    return from_px * ProjectionDerivative(offset);
  }

  // Returns the first database image of a track, whose pose and repeated structures its matches share; in a group the
  // last query image if there is none.
  int Cluster(const Track& track) const {
    for (const TrackObservation& element : track.observations) {
      if (posed_.IsDatabase(element.image)) return element.image;
    }
    return track.observations.back().image;
  }

  // Sets what errors that matches share add to the frame's parameters, and the factor of common errors. The latter is
  // measured where the correction that the score suggests is made, because wrong intrinsics would else make the images
  // disagree, and with the scatter of what single tracks add (White 1980) as the variance by independent errors,
  // because robust weights make it smaller than the information. columns: the frame's, of the inverse of the poses'
  // equations.
  void SetSharedErrors(const FrameColumns& columns, const Moves& poses_from_correction,
                       const std::vector<size_t>& tracks) {
    IntrinsicsScore::Vector correction = IntrinsicsScore::Vector::Zero();
    correction.head<kNumTestedIntrinsics>() =
        score_.information.topLeftCorner<kNumTestedIntrinsics, kNumTestedIntrinsics>().ldlt().solve(
            score_.score.head<kNumTestedIntrinsics>());
    ClusterCovariance<kSize> of_frame;
    bool has_depths = false;
    Pattern score = Pattern::Zero();
    PatternMatrix scatter = PatternMatrix::Zero();
    const PatternFromColumns pattern_from_columns = EliminateCorrections();
    for (const size_t track : tracks) {
      const std::optional<TrackInfluence> influence = Influence(track, columns, poses_from_correction, correction);
      has_depths |= !influence;
      if (!influence) continue;
      of_frame.Add(Cluster(tracks_[track]), influence->frame);
      const Pattern of_patterns = pattern_from_columns * influence->score;
      score += of_patterns;
      scatter += of_patterns * of_patterns.transpose();
    }
    if (of_frame.NumClusters() > 0) {
      const double factor = of_frame.SmallSampleFactor(kNumClusterParameters);
      score_.frame_shared_errors = factor * of_frame.Excess(columns.template topRows<kSize>());
      if (!has_depths) score_.small_sample_factor += EstimatedErrorProbability() * (factor - 1);
    }
    const Eigen::CompleteOrthogonalDecomposition<PatternMatrix> solver(scatter);
    const double squares = score.dot(solver.solve(score)), num_squares = static_cast<double>(solver.rank());
    const double excess = std::max(squares - num_squares, 0.0);  // over the squares of independent errors
    score_.common_error_factor =
        std::max(1.0, (kCommonErrorFactor + squares + kExcessWeight * excess) / (1 + num_squares));
  }

  // Returns the probability that the database poses have errors, if the sizes of these errors are estimated.
  double EstimatedErrorProbability() const {
    if (posed_.prior_groups.empty() || posed_.prior_groups.front().HasStatedSizes()) return 0;
    return 1 - posed_.prior_groups.front().exact_probability;
  }

  // Returns what makes the equations of the patterns from those of all columns. A focal length that is estimated has
  // been eliminated with the pose.
  PatternFromColumns EliminateCorrections() const {
    const int first = IsFocalLengthEstimated() ? 1 : 0, num = NUM_INTRINSICS_PARAMETERS - first;
    PatternFromColumns pattern_from_columns = PatternFromColumns::Zero();
    pattern_from_columns.template rightCols<kNumPatterns>().setIdentity();
    pattern_from_columns.middleCols(first, num) =
        -information_.block(first, first, num, num)
             .ldlt()
             .solve(information_.block(first, NUM_INTRINSICS_PARAMETERS, num, kNumPatterns))
             .transpose();
    return pattern_from_columns;
  }

  // What a track adds to the frame's parameters, and to the score of all columns after a correction.
  struct TrackInfluence {
    Eigen::Matrix<double, kSize, 1> frame = Eigen::Matrix<double, kSize, 1>::Zero();
    Eigen::Matrix<double, kNumColumns, 1> score = Eigen::Matrix<double, kNumColumns, 1>::Zero();
  };

  // Returns nullopt for a track with depths.
  std::optional<TrackInfluence> Influence(size_t track, const FrameColumns& columns, const Moves& poses_from_correction,
                                          const IntrinsicsScore::Vector& correction) const {
    const BundleProblem& problem = solver_.Problem();
    const BundleState& state = solver_.Linearization();
    const auto& equations = solver_.Equations();
    const auto& point = equations.point_factors[track];
    TrackInfluence influence;
    Eigen::Vector3d point_gradient = point.gradient;  // after the correction
    ByPoint by_point = ByPoint::Zero();
    const Range& range = problem.free_range[track];
    for (size_t i = range.begin; i < range.end; ++i) {
      const int frame = problem.free[i].frame;
      if (problem.free[i].depth >= 0) return std::nullopt;
      BundleError error;
      const double root_weight = Evaluate(track, problem.free[i], &error);
      if (root_weight == 0) continue;
      const Eigen::Index place = kSize * place_of_frame_[frame];
      const Eigen::Matrix<double, kSize, 2> by_frame = error.ByFrame<kSize>();
      Derivative derivative = by_frame.transpose() * poses_from_correction.template middleRows<kSize>(place);
      if (is_query_pose_[frame]) derivative += NormalisedDerivative(track, problem.free[i], root_weight, error);
      influence.frame -= columns.template middleRows<kSize>(place).transpose() * (by_frame * error.error);
      const Eigen::Matrix<double, 2, 3> by_point_in_world = error.ByPointInWorld(state.frames[frame]);
      const Eigen::Vector2d change = derivative.template leftCols<NUM_INTRINSICS_PARAMETERS>() * correction;
      influence.score -= derivative.transpose() * (error.error + change);
      by_point += derivative.transpose() * by_point_in_world;
      point_gradient += point.inverse * by_point_in_world.transpose() * change;
    }
    for (size_t i = range.begin; i < range.end; ++i) {
      const Eigen::Index place = kSize * place_of_frame_[problem.free[i].frame];
      influence.frame +=
          columns.template middleRows<kSize>(place).transpose() * (equations.eliminated[i] * point.gradient);
    }
    influence.score += by_point * point.inverse.transpose() * point_gradient;
    return influence;
  }

  // Replaces the equation of the focal length by that of its estimate. column: the factor's, of the inverse of the
  // poses' equations.
  void SetEstimatedFocalLength(const Eigen::VectorXd& column) {
    const double variance = column[kSize - 1];
    score_.information.row(LOG_FOCAL_FACTOR).setZero();
    score_.information.col(LOG_FOCAL_FACTOR).setZero();
    score_.information(LOG_FOCAL_FACTOR, LOG_FOCAL_FACTOR) = 1 / variance;
    score_.score[LOG_FOCAL_FACTOR] = 0;
    score_.frame_from_correction.col(LOG_FOCAL_FACTOR) = column.head<6>() / variance;
  }

  const BundleSolver<kSize>& solver_;
  const PosedImages& posed_;
  const std::vector<Track>& tracks_;
  const RobustLoss& loss_;
  const int frame_;  // of the problem
  Information information_ = Information::Zero();
  Eigen::Matrix<double, kNumColumns, 1> score_of_columns_ = Eigen::Matrix<double, kNumColumns, 1>::Zero();
  IntrinsicsScore score_;
  std::vector<bool> is_query_pose_;  // by frame of the problem: true for the poses of the query's images
  std::vector<int> places_;          // frames in the order of the equations; first, the frame in question
  std::vector<int> place_of_frame_;  // -1 for others
  std::vector<Coupling> couplings_;  // parallel to places_
};

}  // namespace

template <int kSize>
std::vector<IntrinsicsScore> ComputeIntrinsicsScores(const BundleSolver<kSize>& solver, const PosedImages& posed,
                                                     const std::vector<Track>& tracks, const RobustLoss& loss) {
  std::vector<std::vector<size_t>> tracks_of_frame(posed.frames.size());
  for (size_t track = 0; track < tracks.size(); ++track) {
    int last_frame = -1;
    for (const TrackObservation& element : tracks[track].observations) {
      const int frame = posed.images[element.image].frame;
      if (posed.frames[frame].is_database) break;
      if (frame != last_frame) tracks_of_frame[frame].push_back(track);
      last_frame = frame;
    }
  }
  std::vector<IntrinsicsScore> scores(posed.frames.size());
  for (size_t frame = 0; frame < scores.size(); ++frame) {
    if (tracks_of_frame[frame].empty()) continue;
    ScoreBuilder<kSize> builder(solver, posed, tracks, loss, static_cast<int>(frame));
    for (const size_t track : tracks_of_frame[frame]) builder.AddTrack(track);
    scores[frame] = builder.Finish(tracks_of_frame[frame]);
  }
  return scores;
}

template std::vector<IntrinsicsScore> ComputeIntrinsicsScores<6>(const BundleSolver<6>&, const PosedImages&,
                                                                 const std::vector<Track>&, const RobustLoss&);
template std::vector<IntrinsicsScore> ComputeIntrinsicsScores<7>(const BundleSolver<7>&, const PosedImages&,
                                                                 const std::vector<Track>&, const RobustLoss&);

}  // namespace lazyloc
