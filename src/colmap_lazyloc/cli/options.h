#pragma once

#include <filesystem>
#include <string>

#include "colmap_lazyloc/io/photo_loader.h"
#include "colmap_lazyloc/io/problem_loader.h"
#include "colmap_lazyloc/pipeline/options.h"

namespace lazyloc {

// Everything that `colmap lazy_localizer` takes.
struct CommandOptions {
  std::string database_path, input_path, output_path, query_list_path, pairs_path;
  std::string rig_config_path, group_list_path, query_trajectory_path;
  int num_threads = -1;
  bool strict = false;
  std::string matches_output_path;
  ProblemLoaderOptions loader;
  PhotoLoaderOptions photos;
  LocalizerOptions localizer;
};

// Everything that `colmap lazy_indexer` takes.
struct IndexerOptions {
  std::string database_path, index_path;
  RetrievalOptions retrieval;
};

// Parses the command line, and the file that --project_path names (COLMAP's .ini form; the command line wins).
// Returns false where only the help was asked for and printed. Throws InputError naming the option for an unknown or
// missing option, or a value that cannot be.
bool ParseCommandLine(int argc, char** argv, CommandOptions* options);
bool ParseCommandLine(int argc, char** argv, IndexerOptions* options);

// All effective options in COLMAP's .ini form: --project_path takes it again.
std::string OptionsAsIni(const CommandOptions& options);

}  // namespace lazyloc
