#include "colmap_lazyloc/io/query_source.h"

#include <utility>

#include "colmap_lazyloc/io/model_reader.h"
#include "colmap_lazyloc/scene/options_check.h"

namespace lazyloc {

bool SourceOptions::Check(std::string* error) const {
  OPTION_GE(num_retrieved, 1);
  if (!photos.image_path.empty() && selection.leave_one_out) {
    *error = "image_path excludes --LazyLocalizer.leave_one_out, whose queries are posed images of the database";
    return false;
  }
  return selection.groups.Check(error) && photos.Check(error);
}

QuerySource::QuerySource(const SourceOptions& options, const TwoViewGeometryOptions& verification, int seed,
                         int num_threads)
    : database_(options.database_path),
      selection_(database_, ReadModel(options.input_path), options.selection, !options.photos.image_path.empty()),
      pair_loader_(selection_, options.num_retrieved),
      max_num_pairs_(options.selection.pairs_path.empty() ? options.num_retrieved : 0) {
  if (selection_.Photos().empty()) return;
  const PairMatchingOptions pair_options = {options.photos.matching.matching, verification, seed};
  photo_loader_ = std::make_unique<PhotoLoader>(database_, selection_, options.photos, options.num_retrieved,
                                                pair_options, num_threads);
}

QuerySource::Session::Session(const QuerySource& source, IdleThreads* idle_threads)
    : database_(source.database_.Path()), idle_threads_(idle_threads) {
  if (source.photo_loader_) features_ = std::make_unique<FeatureReader>(source.database_.Path());
}

std::optional<LocalizationProblem> QuerySource::LoadQuery(const std::string& name, Session* session,
                                                          QueryRecord* record) const {
  record->result.query_name = name;
  if (const StoredQuery* query = selection_.FindStoredQuery(name)) {
    const StageTimer timer("load", &record->seconds);
    record->intrinsics_source = query->source;
    return pair_loader_.Load(*query, session->database_);
  }
  return photo_loader_->Load(selection_.Photos().at(name), *session->features_, session->idle_threads_, record);
}

LoadedGroup QuerySource::Load(size_t group, Session* session) const {
  LoadedGroup loaded;
  loaded.group.has_rig_scale = selection_.HasRigScale();
  for (const QueryFrame& frame : selection_.Groups()[group]) {
    const int frame_index = static_cast<int>(loaded.group.frame_names.size());
    for (const QueryFrame::Image& image : frame.images) {
      QueryRecord record;
      std::optional<LocalizationProblem> problem = LoadQuery(image.name, session, &record);
      if (problem) {
        loaded.group.images.push_back({*std::move(problem), frame_index, image.cam_from_rig});
        loaded.records.push_back(std::move(record));
      } else {
        loaded.failures.push_back(std::move(record));
      }
    }
    const bool has_images = !loaded.group.images.empty() && loaded.group.images.back().frame == frame_index;
    if (has_images) loaded.group.frame_names.push_back(frame.name);
  }
  pair_loader_.LoadQueryPairs(session->database_, &loaded.group);
  return loaded;
}

void QuerySource::PublishMatches() const {
  if (photo_loader_) photo_loader_->PublishMatches();
}

}  // namespace lazyloc
