// lazyloc_ablation_benchmark ABLATION DATABASE MODEL QUERY_LIST NUM_RETRIEVED SEED LEAVE_ONE_OUT
//
// Localizes queries by an ablation of the paper's method, on one thread. Options are those of colmap lazy_localizer.
// Prints a line for each query, with tabs between: its name, status, seconds, and the pose cam_from_world as qw qx qy
// qz tx ty tz if the status is LOCALIZED.

#include <chrono>
#include <cstdlib>
#include <iomanip>
#include <iostream>
#include <limits>

#include "ablation.h"
#include "colmap_lazyloc/formats/model_reader.h"
#include "colmap_lazyloc/loading/query_source.h"
#include "colmap_lazyloc/scene/errors.h"

namespace lazyloc {
namespace {

void Print(const std::string& query_name, const AblatedResult& result, double seconds) {
  std::cout << query_name << '\t' << QueryStatusName(result.status) << '\t' << seconds;
  if (result.status == QueryStatus::LOCALIZED) {
    const Eigen::Quaterniond& q = result.cam_from_world.rotation;
    const Eigen::Vector3d& t = result.cam_from_world.translation;
    for (const double number : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) std::cout << '\t' << number;
  }
  std::cout << '\n';
}

void Run(const std::string& ablation, const SourceOptions& source_options, const LocalizerOptions& options) {
  const QuerySource source(source_options, ReadModel(source_options.input_path), options.seed, /*num_threads=*/1);
  IdleThreads idle_threads(0);
  QuerySource::Session session(source, &idle_threads);
  std::cout << std::setprecision(std::numeric_limits<double>::max_digits10);
  for (size_t group = 0; group < source.NumGroups(); ++group) {
    const auto start = std::chrono::steady_clock::now();
    const LoadedGroup loaded = source.Load(source.Group(group), source.FirstAttempt(), nullptr, &session);
    for (const QueryImage& image : loaded.group.images) {
      QueryGroup query;
      query.frame_names = {""};
      query.images.push_back({image.problem, 0, {}});
      const AblatedResult result = LocalizeByAblation(ablation, query, options);
      const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
      Print(image.problem.query_name, result, elapsed.count() / static_cast<double>(loaded.group.images.size()));
    }
  }
}

}  // namespace
}  // namespace lazyloc

int main(int argc, char** argv) {
  if (argc != 8) {
    std::cerr << "usage: " << argv[0] << " ABLATION DATABASE MODEL QUERY_LIST NUM_RETRIEVED SEED LEAVE_ONE_OUT\n"
              << "ABLATION is one of";
    for (const std::string& name : lazyloc::AblationNames()) std::cerr << ' ' << name;
    std::cerr << std::endl;
    return EXIT_FAILURE;
  }
  lazyloc::SourceOptions source;
  source.database_path = argv[2];
  source.input_path = argv[3];
  source.selection.query_list_path = argv[4];
  source.num_retrieved = std::atoi(argv[5]);
  source.selection.leave_one_out = std::atoi(argv[7]) != 0;
  source.reads_database_pairs = false;
  lazyloc::LocalizerOptions options;
  options.seed = std::atoi(argv[6]);
  try {
    lazyloc::Run(argv[1], source, options);
  } catch (const lazyloc::InputError& error) {
    std::cerr << "ERROR: " << error.what() << std::endl;
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
