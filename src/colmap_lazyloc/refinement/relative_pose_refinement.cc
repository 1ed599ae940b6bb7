#include "colmap_lazyloc/refinement/relative_pose_refinement.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include <Eigen/Eigenvalues>

#include "colmap_lazyloc/math/mean_rotation.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {
namespace {

// What an edge says of the free view: its rotation, and the line on which it stands.
struct Proposal {
  Eigen::Quaterniond cam_from_world_rotation;
  Eigen::Vector3d fixed_in_world;
  Eigen::Vector3d dir_fixed_to_free_in_world;
};

struct Pose {
  Eigen::Quaterniond cam_from_world_rotation;
  Eigen::Vector3d cam_in_world;
};

std::vector<Proposal> ProposalsFor(int view, std::vector<RelativePoseEdge> edges, const std::vector<View>& views) {
  std::sort(edges.begin(), edges.end(), [](const auto& a, const auto& b) { return a.fixed_view < b.fixed_view; });
  std::vector<Proposal> proposals;
  for (const RelativePoseEdge& edge : edges) {
    if (edge.free_view != view || edge.free_from_fixed.translation.isZero()) continue;
    const Rigid3d& fixed = views[edge.fixed_view].cam_from_world;
    proposals.push_back({edge.free_from_fixed.rotation * fixed.rotation, CamInWorld(fixed),
                         fixed.rotation.conjugate() * CamInWorld(edge.free_from_fixed).normalized()});
  }
  return proposals;
}

double ErrorRad(const Proposal& proposal, const Eigen::Vector3d& cam_in_world) {
  return AngleBetweenRad(cam_in_world - proposal.fixed_in_world, proposal.dir_fixed_to_free_in_world);
}

std::vector<Proposal> Agreeing(const std::vector<Proposal>& proposals, const Eigen::Vector3d& cam_in_world,
                               double max_error_rad) {
  std::vector<Proposal> agreeing;
  for (const Proposal& proposal : proposals) {
    if (ErrorRad(proposal, cam_in_world) < max_error_rad) agreeing.push_back(proposal);
  }
  return agreeing;
}

// None where the lines are parallel, to less than a tenth of a degree for two.
std::optional<Pose> PoseFrom(const std::vector<Proposal>& proposals) {
  std::vector<WeightedRotation> rotations;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
  for (const Proposal& proposal : proposals) {
    const Eigen::Vector3d& dir = proposal.dir_fixed_to_free_in_world;
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - dir * dir.transpose();
    normal += across;
    rhs += across * proposal.fixed_in_world;
    rotations.push_back({proposal.cam_from_world_rotation});
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(normal);
  if (!(eigen.eigenvalues()(0) > 1e-6)) return std::nullopt;
  return Pose{MeanRotation(rotations), eigen.eigenvectors() * eigen.eigenvalues().cwiseInverse().asDiagonal() *
                                           eigen.eigenvectors().transpose() * rhs};
}

// The best pose so far.
struct Best {
  std::optional<Pose> pose;
  size_t num_agreeing = 1;  // a pose needs two
  double error_rad = 0;

  void Try(const std::optional<Pose>& other, const std::vector<Proposal>& proposals, double max_error_rad) {
    if (!other) return;
    const std::vector<Proposal> agreeing = Agreeing(proposals, other->cam_in_world, max_error_rad);
    double sum_rad = 0;
    for (const Proposal& proposal : agreeing) sum_rad += ErrorRad(proposal, other->cam_in_world);
    if (agreeing.size() < num_agreeing || (agreeing.size() == num_agreeing && !(sum_rad < error_rad))) return;
    *this = {other, agreeing.size(), sum_rad};
  }
};

Best Optimize(const RelativePoseRefinementOptions& options, const std::vector<Proposal>& proposals,
              const Eigen::Vector3d& start_in_world, std::mt19937* random) {
  constexpr size_t kMaxSampleSize = 14, kMinSampleSize = 3;
  const double max_error_rad = DegToRad(options.max_direction_error_deg);
  Best best;
  const std::optional<Pose> base = PoseFrom(Agreeing(proposals, start_in_world, M_SQRT2 * max_error_rad));
  if (!base) return best;
  best.Try(base, proposals, max_error_rad);
  std::vector<Proposal> sample = Agreeing(proposals, base->cam_in_world, max_error_rad);
  const size_t sample_size = std::min(kMaxSampleSize, sample.size() / 2);
  if (sample_size < kMinSampleSize) return best;
  for (int i = 0; i < options.num_samples; ++i) {
    std::shuffle(sample.begin(), sample.end(), *random);
    best.Try(PoseFrom({sample.begin(), sample.begin() + static_cast<std::ptrdiff_t>(sample_size)}), proposals,
             max_error_rad);
  }
  return best;
}

}  // namespace

bool RelativePoseRefinementOptions::Check(std::string* error) const {
  OPTION_GT(max_direction_error_deg, 0);
  OPTION_GE(num_samples, 0);
  return true;
}

StageSummary RefineByRelativePoses(const RelativePoseRefinementOptions& options,
                                   const std::vector<RelativePoseEdge>& edges, uint32_t seed,
                                   std::vector<View>* views) {
  StageSummary summary = {true, "refined", 0, 0};
  std::mt19937 random(seed);
  std::vector<View> refined = *views;
  for (size_t view = 0; view < views->size(); ++view) {
    Rigid3d& cam_from_world = refined[view].cam_from_world;
    if (refined[view].is_database) continue;
    const std::vector<Proposal> proposals = ProposalsFor(static_cast<int>(view), edges, *views);
    const Best best = Optimize(options, proposals, CamInWorld(cam_from_world), &random);
    if (!best.pose) return {false, "no two relative poses of a view agree on its position", 0, 0};
    cam_from_world = CamFromWorld(best.pose->cam_from_world_rotation, best.pose->cam_in_world);
    summary.cost += best.error_rad;
    summary.iterations += options.num_samples;
  }
  *views = std::move(refined);
  return summary;
}

}  // namespace lazyloc
