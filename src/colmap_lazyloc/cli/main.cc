// Adds the commands lazy_extractor, lazy_indexer, lazy_localizer and lazy_merger to the colmap program. COLMAP's own
// main, which the build renames to ColmapUpstreamMain, runs all other commands.
#include <algorithm>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/bridge/sift_extractor.h"
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
              "  lazy_extractor\n  lazy_indexer\n  lazy_localizer\n  lazy_merger\n");
  std::cout << help << std::flush;
  return exit_code;
}

// Runs COLMAP's feature_extractor with our SIFT features, on the CPU unless an option says otherwise.
int RunLazyExtractor(int argc, char** argv) {
  if (argc == 2 || IsHelp(argc - 1, argv + 1)) {
    std::cout
        << "colmap lazy_extractor: COLMAP's feature_extractor, with its options and features, in a third of its time "
           "on the CPU."
        << std::endl;
  }
  lazyloc::ReplaceSiftExtractor();
  std::vector<std::string> words(argv, argv + argc);
  words[1] = "feature_extractor";
  const std::string option = lazyloc::kUseGpuOption;
  const auto is_option = [&](const std::string& word) { return word.substr(0, word.find('=')) == option; };
  if (argc > 2 && std::none_of(words.begin(), words.end(), is_option)) words.push_back(option + "=0");
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return ColmapUpstreamMain(static_cast<int>(words.size()), pointers.data());
}

}  // namespace

int main(int argc, char** argv) {
  if (IsHelp(argc, argv)) return ShowHelp(argc, argv);
  const std::string command = argv[1];
  if (command == "lazy_extractor") return RunLazyExtractor(argc, argv);
  const auto run = command == "lazy_indexer"     ? lazyloc::RunLazyIndexer
                   : command == "lazy_localizer" ? lazyloc::RunLazyLocalizer
                   : command == "lazy_merger"    ? lazyloc::RunLazyMerger
                                                 : nullptr;
  if (run == nullptr) return ColmapUpstreamMain(argc, argv);
  lazyloc::InitializeLogging(argv);
  return run(argc - 1, argv + 1);
}
