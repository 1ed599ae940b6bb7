#include "colmap_lazyloc/localizer/localizer.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <utility>

#include "colmap_lazyloc/localizer/attempts.h"
#include "colmap_lazyloc/noise/database_pose_errors.h"
#include "colmap_lazyloc/pipeline/make_record.h"
#include "colmap_lazyloc/pipeline/solve_group.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

// A group as one attempt has loaded it, and what is chosen for each of its images.
struct Tried {
  LoadedGroup loaded;
  std::vector<ImageChoice> choices;
};

bool AreAllLocalized(const std::vector<ImageChoice>& choices, const LocalizerOptions& options) {
  return std::none_of(choices.begin(), choices.end(), [&](const ImageChoice& image) {
    return RefusalOf(*image.choice, image.query, options).has_value();
  });
}

// Keeps the better attempt at each image, and the seconds of both.
void KeepBetter(Tried* later, Tried* tried, const LocalizerOptions& options) {
  for (size_t i = 0; i < tried->choices.size(); ++i) {
    QueryRecord& record = tried->loaded.records[i];
    QueryRecord& later_record = later->loaded.records[i];
    StageTimer::Seconds seconds = std::move(record.seconds);
    for (const auto& [stage, elapsed] : later_record.seconds) StageTimer::Add(stage, elapsed, &seconds);
    const std::shared_ptr<const Choice> later_choice = later->choices[i].choice;
    tried->choices[i] = Better(std::move(tried->choices[i]), std::move(later->choices[i]), options);
    if (tried->choices[i].choice == later_choice) record = std::move(later_record);
    record.seconds = std::move(seconds);
  }
}

// Returns which queries share a camera. Nobody corrects intrinsics that are kept as they are.
CameraSharing SharingOf(const SourceOptions& source, const LocalizerOptions& options) {
  if (source.single_camera) return CameraSharing::ALL;
  const bool keeps_cameras = options.method == Method::PAPER || options.intrinsics == IntrinsicsMode::GIVEN ||
                             source.single_camera_per_image || source.selection.leave_one_out;
  return keeps_cameras ? CameraSharing::NONE : CameraSharing::DATABASE;
}

bool IsSingle(const GroupInput& input) { return input.frames.size() == 1 && input.frames.front().images.size() == 1; }

}  // namespace

// A session that a call uses alone.
class Localizer::BorrowedSession {
 public:
  explicit BorrowedSession(const Localizer& localizer) : localizer_(localizer) {
    if (!localizer.source_) return;
    {
      const std::lock_guard<std::mutex> lock(localizer_.sessions_mutex_);
      if (localizer_.process_ != getpid()) {
        // Leaves the parent's connections alone, because SQLite must not even close them in a forked process.
        for (auto& session : localizer_.sessions_) static_cast<void>(session.release());
        localizer_.sessions_.clear();
        localizer_.process_ = getpid();
      }
      if (!localizer_.sessions_.empty()) {
        session_ = std::move(localizer_.sessions_.back());
        localizer_.sessions_.pop_back();
      }
    }
    if (!session_) session_ = std::make_unique<QuerySource::Session>(*localizer_.source_, localizer_.idle_threads_);
  }
  ~BorrowedSession() {
    if (!session_) return;
    const std::lock_guard<std::mutex> lock(localizer_.sessions_mutex_);
    localizer_.sessions_.push_back(std::move(session_));
  }
  BorrowedSession(const BorrowedSession&) = delete;
  BorrowedSession& operator=(const BorrowedSession&) = delete;

  QuerySource::Session* Get() { return session_.get(); }

 private:
  const Localizer& localizer_;
  std::unique_ptr<QuerySource::Session> session_;  // null without a database
};

Localizer::Localizer(const SourceOptions& source, const LocalizerOptions& options, Model model, int num_threads,
                     IdleThreads* idle_threads)
    : options_(options), idle_threads_(idle_threads), sharing_(SharingOf(source, options)), process_(getpid()) {
  if (source.database_path.empty()) {
    if (!source.depth.depth_path.empty()) throw InputError("option depth_path needs a database");
    model_ = std::move(model);
    return;
  }
  SourceOptions with_pairs = source;
  // Reads no pairs of database images if nothing corrects database poses, or if the options state their errors.
  with_pairs.reads_database_pairs =
      options.method == Method::EXTENDED && ExpectPoseErrors(options).source == PoseNoiseSource::DEFAULT;
  source_ = std::make_unique<QuerySource>(with_pairs, std::move(model), options.seed, num_threads);
  for (auto& [key, groups] : CalibrationGroups(source_->Selection(), sharing_)) {
    query_cameras_[key].groups = std::move(groups);
  }
}

LoadedGroup Localizer::Load(const GroupInput& input, const Attempt& attempt, const LoadedGroup* first,
                            QuerySource::Session* session) const {
  if (source_) return source_->Load(input, attempt, first, session);
  return LoadEach(input, [](const GroupInput::Image& image, QueryRecord*) {
    if (const auto* problem = std::get_if<LocalizationProblem>(&image.query)) return *problem;
    throw InputError("only queries with matches of their own can do without a database");
  });
}

std::vector<Attempt> Localizer::FirstAttempts(const GroupInput& input) const {
  Attempt attempt = source_ ? source_->FirstAttempt() : Attempt();
  if (!source_ || !source_->HasNearImages(input)) return {attempt};
  Attempt near = attempt;
  near.only_near = true;
  return {near, attempt};
}

std::optional<CalibrationQuery> Localizer::EstimateCamera(const GroupInput& input) const {
  BorrowedSession session(*this);
  for (Attempt attempt : FirstAttempts(input)) {
    attempt.only_unknown_cameras = true;
    attempt.writes_matches = false;
    LoadedGroup loaded = Load(input, attempt, nullptr, session.Get());
    if (loaded.group.images.empty()) return std::nullopt;
    const ImageChoice image = SolveGroup(loaded.group, options_).front();
    const Solution& solution = *image.choice->solution;
    if (!solution.hypothesis.estimates_focal_length || RefusalOf(*image.choice, 0, options_)) continue;
    const IntrinsicsResult& intrinsics = solution.checked.results.front();
    return CalibrationQuery{std::move(loaded.group), *solution.checked.cameras.front(),
                            std::log(intrinsics.focal_factor),
                            intrinsics.focal_factor_stddev / intrinsics.focal_factor};
  }
  return std::nullopt;
}

const SharedCameras& Localizer::EstimateCamera(uint32_t key, CameraOfQueries* camera) const {
  std::call_once(camera->is_estimated, [&] {
    std::vector<std::optional<CalibrationQuery>> estimates(camera->groups.size());
    ParallelFor(
        estimates.size(), [&](size_t i) { estimates[i] = EstimateCamera(source_->Group(camera->groups[i])); },
        idle_threads_);
    std::vector<CalibrationQuery> localized;
    for (std::optional<CalibrationQuery>& estimate : estimates) {
      if (estimate) localized.push_back(*std::move(estimate));
    }
    camera->estimates = EstimateSharedCameras(localized, options_, idle_threads_);
    for (SharedCamera& shared : camera->estimates) shared.database_id = key;
  });
  return camera->estimates;
}

SharedCameras Localizer::EstimateCameras() const {
  SharedCameras cameras;
  for (auto& [key, camera] : query_cameras_) {
    const SharedCameras& estimates = EstimateCamera(key, &camera);
    cameras.insert(cameras.end(), estimates.begin(), estimates.end());
  }
  return cameras;
}

const SharedCameras* Localizer::CamerasOf(const GroupInput& input) const {
  if (!IsSingle(input) || query_cameras_.empty()) return nullptr;
  const auto* const name = std::get_if<std::string>(&input.frames.front().images.front().query);
  if (name == nullptr && sharing_ != CameraSharing::ALL) return nullptr;
  const std::optional<uint32_t> key = SharedCameraKey(source_->Selection(), sharing_, name == nullptr ? "" : *name);
  const auto camera = key ? query_cameras_.find(*key) : query_cameras_.end();
  return camera == query_cameras_.end() ? nullptr : &EstimateCamera(camera->first, &camera->second);
}

std::vector<QueryRecord> Localizer::Localize(const GroupInput& input, bool with_keypoints) const {
  const auto start = std::chrono::steady_clock::now();
  BorrowedSession session(*this);
  std::vector<std::unique_ptr<Tried>> all;  // whose groups the choices refer to
  const auto solve = [&](const Attempt& attempt, const LoadedGroup* first) {
    Tried* next = all.emplace_back(std::make_unique<Tried>()).get();
    next->loaded = Load(input, attempt, first, session.Get());
    next->choices = SolveGroup(next->loaded.group, options_);
    return next;
  };
  Tried* near = nullptr;
  Tried* tried = nullptr;
  const SharedCameras* const cameras = CamerasOf(input);
  for (Attempt first : FirstAttempts(input)) {
    first.shared_cameras = cameras;
    near = std::exchange(tried, solve(first, nullptr));
    if (AreAllLocalized(tried->choices, options_)) break;
    if (first.only_near || !source_) continue;
    for (const Attempt& attempt : FurtherAttempts(*source_, input, first, tried->loaded)) {
      KeepBetter(solve(attempt, &tried->loaded), tried, options_);
      if (AreAllLocalized(tried->choices, options_)) break;
    }
  }
  if (near != nullptr) KeepBetter(near, tried, options_);
  std::vector<QueryRecord> records;
  for (RefusedQuery& refused : tried->loaded.refused) {
    AddRefusal(refused.refusal, &refused.record);
    records.push_back(std::move(refused.record));
  }
  std::vector<LocalizationResult> results = MakeResults(tried->choices, options_);
  for (size_t i = 0; i < results.size(); ++i) {
    QueryRecord& record = tried->loaded.records[i];
    AddResult(std::move(results[i]), &record);
    std::vector<Eigen::Vector2d>& keypoints = tried->loaded.group.images[i].problem.query_keypoints;
    if (with_keypoints && record.keypoints.empty()) record.keypoints = std::move(keypoints);
    records.push_back(std::move(record));
  }
  const double total = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  for (QueryRecord& record : records) record.total_seconds = total / static_cast<double>(records.size());
  return records;
}

}  // namespace lazyloc
