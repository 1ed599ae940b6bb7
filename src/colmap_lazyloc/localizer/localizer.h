#pragma once

#include <sys/types.h>

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/loading/calibration_groups.h"
#include "colmap_lazyloc/loading/query_source.h"
#include "colmap_lazyloc/localizer/shared_cameras.h"
#include "colmap_lazyloc/math/parallel_for.h"

namespace lazyloc {

// Localizes queries, one group at a time: what happens to a query, for the program and for Python alike. Thread-safe,
// also after a fork, because each process opens the database anew.
class Localizer {
 public:
  // model: the one at source.input_path. Without source.database_path, only queries with matches of their own can be
  // localized. idle_threads: help with the pairs of photos, and outlive this. num_threads: for making the retrieval
  // index; -1: the number of cores. Throws InputError for files and options that cannot be used.
  Localizer(const SourceOptions& source, const LocalizerOptions& options, Model model, int num_threads,
            IdleThreads* idle_threads);

  // Null without a database.
  const QuerySource* Source() const { return source_.get(); }
  // Returns the posed images that queries are localized against.
  const Model& DatabaseModel() const { return source_ ? source_->DatabaseModel() : model_; }

  // Returns the cameras that queries of the selection share (calibration_groups.h), which Localize estimates, too, as
  // soon as it needs one. Throws InputError for a damaged file.
  SharedCameras EstimateCameras() const;
  // Loads a group, localizes it by one attempt after the other, and returns a record per query, those that cannot be
  // loaded first. with_keypoints: the records have all keypoints, not only those of photos. Uses the calling thread,
  // and idle ones for photos. Throws InputError for a damaged file.
  std::vector<QueryRecord> Localize(const GroupInput& input, bool with_keypoints = false) const;

 private:
  class BorrowedSession;
  // A camera that queries share, and the groups that it is estimated from.
  struct CameraOfQueries {
    std::vector<size_t> groups;
    std::once_flag is_estimated;
    SharedCameras estimates;  // by given camera
  };

  LoadedGroup Load(const GroupInput& input, const Attempt& attempt, const LoadedGroup* first,
                   QuerySource::Session* session) const;
  // Returns what the queries of a group are tried with first: if a photo has a position, with database images near it,
  // and if that does not localize all, with the best of all database images.
  std::vector<Attempt> FirstAttempts(const GroupInput& input) const;
  // Returns nullopt if the query is not localized with estimated intrinsics.
  std::optional<CalibrationQuery> EstimateCamera(const GroupInput& input) const;
  // Estimates a camera unless that is done. key: as in calibration_groups.h.
  const SharedCameras& EstimateCamera(uint32_t key, CameraOfQueries* camera) const;
  // Returns the estimates for a single query; null if it shares no camera.
  const SharedCameras* CamerasOf(const GroupInput& input) const;

  const LocalizerOptions options_;
  IdleThreads* const idle_threads_;
  const CameraSharing sharing_;
  mutable std::map<uint32_t, CameraOfQueries> query_cameras_;  // by key
  Model model_;                                                // empty if there is a database
  std::unique_ptr<QuerySource> source_;                        // null without a database
  mutable std::mutex sessions_mutex_;
  mutable std::vector<std::unique_ptr<QuerySource::Session>> sessions_;  // that no call uses
  mutable pid_t process_;                                                // that has made the sessions
};

}  // namespace lazyloc
