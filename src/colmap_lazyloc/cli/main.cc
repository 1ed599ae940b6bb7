// Adds the commands lazy_indexer, lazy_localizer and lazy_merger to the colmap program. COLMAP's own main, which the
// build renames to ColmapUpstreamMain, runs all other commands.
#include <iostream>
#include <sstream>
#include <string>

#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/cli/commands.h"

int ColmapUpstreamMain(int argc, char** argv);

namespace {

bool IsHelp(int argc, char** argv) {
  if (argc < 2) return true;
  const std::string command = argv[1];
  return command == "help" || command == "-h" || command == "--help";
}

// Prints COLMAP's help with our commands in their place in the list.
int ShowHelp(int argc, char** argv) {
  std::ostringstream upstream;
  std::streambuf* const standard_output = std::cout.rdbuf(upstream.rdbuf());
  const int exit_code = ColmapUpstreamMain(argc, argv);
  std::cout.rdbuf(standard_output);
  std::string help = upstream.str();
  const size_t next_command = help.find("  mapper\n");
  help.insert(next_command == std::string::npos ? help.size() : next_command,
              "  lazy_indexer\n  lazy_localizer\n  lazy_merger\n");
  std::cout << help << std::flush;
  return exit_code;
}

}  // namespace

int main(int argc, char** argv) {
  if (IsHelp(argc, argv)) return ShowHelp(argc, argv);
  const std::string command = argv[1];
  const auto run = command == "lazy_indexer"     ? lazyloc::RunLazyIndexer
                   : command == "lazy_localizer" ? lazyloc::RunLazyLocalizer
                   : command == "lazy_merger"    ? lazyloc::RunLazyMerger
                                                 : nullptr;
  if (run == nullptr) return ColmapUpstreamMain(argc, argv);
  lazyloc::InitializeLogging(argv);
  return run(argc - 1, argv + 1);
}
