#include "colmap_lazyloc/pipeline/query_priors.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>

#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/pipeline/pose_uncertainty.h"
#include "colmap_lazyloc/pipeline/position_ambiguity.h"
#include "colmap_lazyloc/refinement/covariance.h"

namespace lazyloc {
namespace {

// Minimum variance factor beside a prior: as few points as fix a pose fit it exactly, which says nothing of their
// noise.
constexpr double kMinVarianceFactor = 1e-3;

// Quantiles of the chi-square distribution with 2 and 3 degrees of freedom.
struct Quantiles {
  double suspicious;     // 95 %
  double contradictory;  // 99.9 %
};
constexpr Quantiles kTwoDegrees = {5.991, 13.816}, kThreeDegrees = {7.815, 16.266};

// Compares a deviation with its covariance. Returns the factor on the prior's covariance: at least 1, more the more
// suspicious the prior is.
template <typename Vector, typename Matrix>
double Compare(const Vector& deviation, const Matrix& covariance, const Quantiles& quantiles, PriorResult* result) {
  const double squared_sigma = deviation.dot(covariance.ldlt().solve(deviation));
  result->deviation = deviation.norm();
  result->deviation_sigma = std::sqrt(squared_sigma);
  result->verdict = squared_sigma <= quantiles.contradictory ? PriorVerdict::USED : PriorVerdict::CONTRADICTED;
  return std::max(1.0, squared_sigma / quantiles.suspicious);
}

// The pose that the images give a query.
struct ImagePose {
  Rigid3d cam_from_world;
  Eigen::Matrix<double, 6, 6> covariance;
};

double ComparePosition(const PositionPrior& prior, const ImagePose& pose, PriorResult* result) {
  return Compare(Eigen::Vector3d(prior.position - CamInWorld(pose.cam_from_world)),
                 Eigen::Matrix3d(prior.covariance + PositionCovariance(pose.cam_from_world, pose.covariance)),
                 kThreeDegrees, result);
}

// Returns the place on the ray of a bearing that agrees best with a prior, and compares both across the ray. The
// deviation along it is compared only if the prior is behind the database image.
Eigen::Vector3d CompareWithBearing(const PositionPrior& prior, const Bearing& bearing, const Eigen::Vector3d& from,
                                   PriorResult* result, double* factor) {
  const Eigen::Vector3d& direction = bearing.dir_database_to_query_in_world;
  const Eigen::LDLT<Eigen::Matrix3d> covariance(prior.covariance);
  const Eigen::Vector3d information = covariance.solve(direction);
  const Eigen::Vector3d offset = prior.position - from;
  const double stddev_along = 1 / std::sqrt(information.dot(direction));
  // A query is ahead of the database image, at a distance that is not certain to be zero.
  const double distance = std::max(information.dot(offset) * stddev_along * stddev_along, stddev_along);
  const double across = bearing.stddev_rad * distance;
  const Eigen::Matrix3d around = across * across * (Eigen::Matrix3d::Identity() - direction * direction.transpose());
  *factor = Compare(Eigen::Vector3d(offset - distance * direction), Eigen::Matrix3d(prior.covariance + around),
                    kTwoDegrees, result);
  return from + distance * direction;
}

// Judges the priors of one query.
class Judge {
 public:
  // reported: the poses with what the database states (AsReported), because priors are of what is reported.
  Judge(const Layout& layout, const Refined& refined, const PosedImages& reported, int query, PriorJudgement* judgement)
      : layout_(layout), refined_(refined), query_(query), judgement_(*judgement) {
    pose_ = {CamFromWorld(reported, query), TotalCovariance(refined, query)};
  }

  // Judges the priors of a query whose pose the images determine.
  void Determined() {
    const QueryPrior& given = layout_.priors[query_];
    QueryPriorResult& result = judgement_.results[query_];
    if (given.position) UsePosition(ComparePosition(*given.position, pose_, &*result.position));
    CompareGravityIfGiven();
    AddUsed();
  }

  // Judges the priors of a lone image whose position the images leave open. partial: what they determine of it.
  void Open(const PartialPose& partial) {
    const QueryPrior& given = layout_.priors[query_];
    if (!given.position) return;  // gravity does not fix a position
    PriorResult& result = *judgement_.results[query_].position;
    Eigen::Vector3d place;
    if (partial.bearing) {
      double factor = 1;
      place = CompareWithBearing(*given.position, *partial.bearing, CentreOf(partial.bearing->database_name), &result,
                                 &factor);
      UsePosition(factor);
    } else {
      UsePosition(ComparePosition(*given.position, pose_, &result));
      place = MostProbablePlace(*given.position);
    }
    if (result.verdict != PriorVerdict::USED) return;
    result.fixes = PriorRole::DISTANCE;
    judgement_.open_line = LineThrough(partial, *used_.position);
    CompareGravityIfGiven();
    AddUsed();
    judgement_.moves_start = true;
    judgement_.start.frames[layout_.FrameOf(query_)].frame_from_world =
        CamFromWorld(pose_.cam_from_world.rotation, place);
  }

 private:
  // Divides by the variance factor, because the covariance of the adjustment is multiplied by it.
  double CovarianceFactor(double factor) const {
    return factor / std::max(refined_.variance_factor, kMinVarianceFactor);
  }

  void UsePosition(double factor) {
    if (judgement_.results[query_].position->verdict != PriorVerdict::USED) return;
    used_.position = layout_.priors[query_].position;
    used_.position->covariance *= CovarianceFactor(factor);
    // Moves the prior to where adjustment has the image.
    used_.position->position +=
        CamInWorld(CamFromWorld(refined_.adjustment.posed, query_)) - CamInWorld(pose_.cam_from_world);
  }

  void CompareGravityIfGiven() {
    const std::optional<GravityPrior>& gravity = layout_.priors[query_].gravity;
    if (!gravity) return;
    PriorResult& result = *judgement_.results[query_].gravity;
    const double factor =
        JudgeGravity(*gravity, pose_.cam_from_world.rotation, pose_.covariance.topLeftCorner<3, 3>(), &result);
    if (result.verdict != PriorVerdict::USED) return;
    used_.gravity = gravity;
    used_.gravity->stddev_rad *= std::sqrt(CovarianceFactor(factor));
  }

  void AddUsed() {
    if (used_.position || used_.gravity) judgement_.used.push_back({query_, used_});
  }

  // Returns the line that the images leave open: that of the bearing, or the least certain axis.
  OpenLine LineThrough(const PartialPose& partial, const PositionPrior& used) const {
    const Eigen::Vector3d direction =
        partial.bearing ? partial.bearing->dir_database_to_query_in_world
                        : ComputePoseSpread(pose_.cam_from_world, pose_.covariance).weakest_direction_in_world;
    const double information = direction.dot(used.covariance.ldlt().solve(direction));
    return {direction, std::max(refined_.variance_factor, kMinVarianceFactor) / information};
  }

  Eigen::Vector3d CentreOf(const std::string& database_name) const {
    const auto name = std::find(layout_.names.begin() + layout_.num_queries, layout_.names.end(), database_name);
    return CamInWorld(CamFromWorld(layout_.given, static_cast<int>(name - layout_.names.begin())));
  }

  // Returns the position by the images and the prior together.
  Eigen::Vector3d MostProbablePlace(const PositionPrior& prior) const {
    const Eigen::Vector3d centre = CamInWorld(pose_.cam_from_world);
    const Eigen::Matrix3d covariance = PositionCovariance(pose_.cam_from_world, pose_.covariance);
    const Eigen::Matrix3d sum = covariance + prior.covariance;
    return centre + covariance * sum.ldlt().solve(prior.position - centre);
  }

  const Layout& layout_;
  const Refined& refined_;
  const int query_;
  PriorJudgement& judgement_;
  ImagePose pose_;
  QueryPrior used_;
};

}  // namespace

double JudgeGravity(const GravityPrior& prior, const Eigen::Quaterniond& cam_from_world_rotation,
                    const Eigen::Matrix3d& covariance, PriorResult* result) {
  const Eigen::Vector3d down = cam_from_world_rotation * prior.down_in_world;
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(down);
  // Turns opposite directions, whose cross product is zero, about any axis.
  Eigen::Vector2d axis = basis.transpose() * down.cross(prior.down_in_cam);
  axis = axis.isZero(1e-9) ? Eigen::Vector2d::UnitX() : Eigen::Vector2d(axis.normalized());
  const Eigen::Matrix2d turn_covariance = basis.transpose() * covariance * basis;
  return Compare(Eigen::Vector2d(AngleBetweenRad(down, prior.down_in_cam) * axis),
                 Eigen::Matrix2d(turn_covariance + prior.stddev_rad * prior.stddev_rad * Eigen::Matrix2d::Identity()),
                 kTwoDegrees, result);
}

PriorJudgement JudgePriors(const Layout& layout, const PairRefs& pairs, const Refined& refined,
                           const LocalizerOptions& options) {
  PriorJudgement judgement;
  judgement.start = refined.adjustment.posed;
  for (const QueryPrior& prior : layout.priors) judgement.results.push_back(UntestedPriors(prior));
  const PosedImages reported = AsReported(layout, refined.adjustment.posed);
  const std::vector<TrackRefs> tracks_of = TracksByFrame(layout, refined.adjustment.tracks);
  for (int query = 0; query < layout.num_queries; ++query) {
    if (!layout.priors[query].position && !layout.priors[query].gravity) continue;
    Judge judge(layout, refined, reported, query, &judgement);
    const int frame = layout.FrameOf(query);
    const AdjustedFrame adjusted{layout, pairs, refined.adjustment, frame, tracks_of[frame], refined.variance_factor};
    if (!IsPositionOpen(adjusted, options)) {
      judge.Determined();
    } else if (layout.num_queries == 1) {
      const Failure failure = OpenPositionFailure(adjusted, refined.variance_factor);
      const auto partial = failure.partial_poses.find(query);
      if (partial != failure.partial_poses.end()) judge.Open(partial->second);
    }
  }
  return judgement;
}

void AdjustWithPriors(const std::vector<ImagePrior>& priors, const LocalizerOptions& options, QueryCamera* camera,
                      Refined* refined) {
  PosedImages posed = refined->adjustment.posed;
  posed.query_priors = priors;
  BundleAdjustmentResult adjustment = AdjustBundle(posed, refined->adjustment.tracks, options.bundle_adjustment);
  if (!adjustment.summary.success) return;
  if (camera != nullptr) {
    camera->ScaleFocalLength(std::exp(*adjustment.posed.images[0].log_focal_factor));
    adjustment.posed.images[0].log_focal_factor = 0;
    adjustment.tracks = camera->Observe(adjustment.tracks);
  }
  refined->adjustment = std::move(adjustment);
  LimitVarianceFactor(refined);
}

void LimitVarianceFactor(Refined* refined) {
  refined->variance_factor = std::max(refined->variance_factor, kMinVarianceFactor);
  refined->SetMissingVariances();
}

bool AreReconciled(const PriorJudgement& judgement, const Refined& refined) {
  return std::all_of(judgement.used.begin(), judgement.used.end(), [&](const ImagePrior& used) {
    if (!used.prior.position) return true;
    PositionPrior prior = *used.prior.position;
    prior.covariance *= refined.variance_factor;
    const Eigen::Vector3d deviation = prior.position - CamInWorld(CamFromWorld(refined.adjustment.posed, used.image));
    return deviation.dot(prior.covariance.ldlt().solve(deviation)) <= kThreeDegrees.contradictory;
  });
}

}  // namespace lazyloc
