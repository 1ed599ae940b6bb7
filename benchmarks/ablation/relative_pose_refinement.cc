#include "relative_pose_refinement.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include "colmap_lazyloc/math/mean_rotation.h"
#include "colmap_lazyloc/math/so3.h"
#include "colmap_lazyloc/math/two_rays.h"
#include "colmap_lazyloc/structure/ray_intersection.h"

namespace lazyloc {
namespace {

constexpr double kMaxDirectionErrorDeg = 5;  // of an edge that agrees with a pose
constexpr int kNumSamples = 10;              // subsets of the edges that agree

// Rotation of a query by an edge, and the line on which the edge puts its centre.
struct Proposal {
  Eigen::Quaterniond cam_from_world_rotation;
  Ray ray;  // from the database image
};

struct Pose {
  Eigen::Quaterniond cam_from_world_rotation;
  Eigen::Vector3d cam_in_world;
};

std::vector<Proposal> ProposalsFor(int query, std::vector<RelativePoseEdge> edges, const PosedImages& posed) {
  std::sort(edges.begin(), edges.end(), [](const auto& a, const auto& b) { return a.database < b.database; });
  std::vector<Proposal> proposals;
  for (const RelativePoseEdge& edge : edges) {
    if (edge.query != query || edge.query_from_database.translation.isZero()) continue;
    const Rigid3d database_from_world = CamFromWorld(posed, edge.database);
    proposals.push_back({edge.query_from_database.rotation * database_from_world.rotation,
                         {CamInWorld(database_from_world), database_from_world.rotation.conjugate() *
                                                               CamInWorld(edge.query_from_database).normalized()}});
  }
  return proposals;
}

double ErrorRad(const Proposal& proposal, const Eigen::Vector3d& cam_in_world) {
  return AngleBetweenRad(cam_in_world - proposal.ray.origin, proposal.ray.dir);
}

std::vector<Proposal> Agreeing(const std::vector<Proposal>& proposals, const Eigen::Vector3d& cam_in_world,
                               double max_error_rad) {
  std::vector<Proposal> agreeing;
  for (const Proposal& proposal : proposals) {
    if (ErrorRad(proposal, cam_in_world) < max_error_rad) agreeing.push_back(proposal);
  }
  return agreeing;
}

// Returns nullopt if the lines are parallel.
std::optional<Pose> PoseFrom(const std::vector<Proposal>& proposals) {
  std::vector<WeightedRotation> rotations;
  RayIntersection intersection;
  for (const Proposal& proposal : proposals) {
    intersection.Add(proposal.ray.origin, proposal.ray.dir);
    rotations.push_back({proposal.cam_from_world_rotation});
  }
  const std::optional<Eigen::Vector3d> cam_in_world = intersection.Point();
  if (!cam_in_world) return std::nullopt;
  return Pose{MeanRotation(rotations), *cam_in_world};
}

// Keeps the best pose.
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

std::optional<Pose> Optimize(const std::vector<Proposal>& proposals, const Eigen::Vector3d& start_in_world,
                             std::mt19937* random) {
  constexpr size_t kMaxSampleSize = 14, kMinSampleSize = 3;
  const double max_error_rad = DegToRad(kMaxDirectionErrorDeg);
  Best best;
  const std::optional<Pose> base = PoseFrom(Agreeing(proposals, start_in_world, M_SQRT2 * max_error_rad));
  if (!base) return std::nullopt;
  best.Try(base, proposals, max_error_rad);
  std::vector<Proposal> sample = Agreeing(proposals, base->cam_in_world, max_error_rad);
  const size_t sample_size = std::min(kMaxSampleSize, sample.size() / 2);
  if (sample_size < kMinSampleSize) return best.pose;
  for (int i = 0; i < kNumSamples; ++i) {
    std::shuffle(sample.begin(), sample.end(), *random);
    best.Try(PoseFrom({sample.begin(), sample.begin() + static_cast<std::ptrdiff_t>(sample_size)}), proposals,
             max_error_rad);
  }
  return best.pose;
}

}  // namespace

PoseRefinementResult RefineByRelativePoses(const PosedImages& posed, const std::vector<RelativePoseEdge>& edges,
                                           uint32_t seed) {
  PoseRefinementResult result = {{true, "refined", 0, 0}, posed};
  std::mt19937 random(seed);
  for (int image = 0; image < static_cast<int>(posed.images.size()); ++image) {
    if (posed.IsDatabase(image)) continue;
    Rigid3d& frame_from_world = result.posed.frames[posed.images[image].frame].frame_from_world;
    const std::optional<Pose> best = Optimize(ProposalsFor(image, edges, posed), CamInWorld(frame_from_world), &random);
    if (!best) return {{false, "no two relative poses of a query agree on its position", 0, 0}, posed};
    frame_from_world = CamFromWorld(best->cam_from_world_rotation, best->cam_in_world);
  }
  return result;
}

}  // namespace lazyloc
