#pragma once

#include <vector>

// The options of colmap lazy_localizer that --help shows; --help-all shows all.
namespace lazyloc {

struct HelpGroup {
  const char* title;
  std::vector<const char*> options;
};

inline const HelpGroup kHelpGroups[] = {
    {"What you need", {"database_path", "input_path", "output_path"}},
    {"Queries", {"query_list_path", "pairs_path", "LazyLocalizer.leave_one_out", "LazyLocalizer.intrinsics"}},
    {"Photos", {"image_path", "retrieval_index_path", "onnx_path"}},
    {"Several at once", {"rig_config_path", "query_trajectory_path", "LazyLocalizer.group_size"}},
    {"Further measurements", {"query_position_path", "query_gravity_path", "depth_path"}},
    {"Output", {"LazyLocalizer.min_confidence", "LazyLocalizer.num_threads", "resume", "strict"}},
};

inline constexpr char kExamples[] =
    R"(Examples:
  colmap lazy_localizer --database_path database.db --input_path model --output_path localized
  colmap lazy_localizer --database_path database.db --input_path model --output_path localized \
      --image_path photos --query_list_path queries.txt
)";

}  // namespace lazyloc
