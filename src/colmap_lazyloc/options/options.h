#pragma once

#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "colmap_lazyloc/epoch/epoch.h"
#include "colmap_lazyloc/group/localizer_options.h"
#include "colmap_lazyloc/loading/query_source.h"
#include "colmap_lazyloc/runs/unfinished_run.h"

namespace lazyloc {

// Everything that `colmap lazy_localizer` takes. Each option has one place here, where it is parsed and read.
struct CommandOptions {
  SourceOptions source;
  LocalizerOptions localizer;
  std::string output_path;
  int num_threads = -1;  // -1: the number of cores
  bool strict = false;
  bool resume = false, overwrite = false;
  std::string shard;  // as text; empty: all queries
  std::string log_path;

  RunStart Start() const { return resume ? RunStart::RESUME : overwrite ? RunStart::OVERWRITE : RunStart::NEW; }
};

// Everything that `colmap lazy_indexer` takes.
struct IndexerOptions {
  std::string database_path, index_path;
  RetrievalOptions retrieval;
  int num_threads = -1;  // -1: the number of cores
};

// Everything that `colmap lazy_merger` takes.
struct MergerOptions {
  std::string input_path, output_path;
  std::string database_path, model_path;  // empty: those of the shards
};

// Everything that `colmap lazy_epoch` takes.
struct EpochCommandOptions {
  std::string database_path, input_path, localized_path, output_path;
  std::string control_points_path;  // empty: none
  bool with_database = false;
  EpochOptions epoch;
};

// Parses the command line and the file that --project_path names (COLMAP's .ini format; the command line wins). Returns
// false if only the help or the version was requested, which is then printed. Throws InputError naming the option if it
// is unknown or missing or has an impossible value.
bool ParseCommandLine(int argc, char** argv, CommandOptions* options);
bool ParseCommandLine(int argc, char** argv, IndexerOptions* options);
bool ParseCommandLine(int argc, char** argv, MergerOptions* options);
bool ParseCommandLine(int argc, char** argv, EpochCommandOptions* options);

// Returns the versions of this program and of COLMAP, for example "colmap_lazyloc 0.1.0, COLMAP 3.10".
std::string ProgramVersion();

// Returns the options that say how queries are localized, each with its default and help: those of colmap
// lazy_localizer without the ones for its output. A program that localizes by itself takes them by ParseSettings.
std::vector<std::tuple<std::string, std::string, std::string>> ListSettings();
// Parses options by name and text like the command line. Throws InputError like ParseCommandLine, but requires none.
void ParseSettings(const OptionTexts& settings, CommandOptions* options);

// What an option does to the results, which decides whether a run can go on with another value.
enum class OptionRole {
  METHOD,   // changes them by its value
  INPUT,    // names a file or folder whose content changes them
  MACHINE,  // says where things are and what the machine has, which does not change them
  OUTPUT,   // says which files a run writes
  START,    // says how a run begins; is not in options.ini, because it does not describe the run
};

// Returns the options of a run that have one of the roles.
OptionTexts OptionsWith(const CommandOptions& options, const std::set<OptionRole>& roles);

// Returns all options in COLMAP's .ini format, which --project_path reads. A comment before them names those that
// differ from their defaults.
std::string OptionsAsIni(const CommandOptions& options);

}  // namespace lazyloc
