// Adds the commands lazy_epoch, lazy_indexer, lazy_localizer and lazy_merger to the colmap program, and commands of
// COLMAP with our SIFT. COLMAP's own main, which the build renames to ColmapUpstreamMain, runs all other commands.
#include <algorithm>
#include <iostream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "colmap_lazyloc/bridge/colmap_program.h"
#include "colmap_lazyloc/bridge/sift_replacement.h"
#include "colmap_lazyloc/cli/commands.h"
#include "colmap_lazyloc/features/descriptor_matching.h"

int ColmapUpstreamMain(int argc, char** argv);

namespace {

// COLMAP's commands that also run with our SIFT features and matches, under the name with this prefix.
const std::string kPrefix = "lazy_";
const std::set<std::string> kReplacedCommands = {"exhaustive_matcher", "feature_extractor", "matches_importer",
                                                 "sequential_matcher", "spatial_matcher",   "transitive_matcher",
                                                 "vocab_tree_matcher"};

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
  std::set<std::string> names = {"lazy_epoch", "lazy_indexer", "lazy_localizer", "lazy_merger"};
  for (const std::string& name : kReplacedCommands) names.insert(kPrefix + name);
  std::string lines;
  for (const std::string& name : names) lines += "  " + name + "\n";
  std::string help = upstream.str();
  const size_t next_command = help.find("  mapper\n");
  help.insert(next_command == std::string::npos ? help.size() : next_command, lines);
  std::cout << help << std::flush;
  return exit_code;
}

// Runs a command of COLMAP with our SIFT, on the CPU unless an option says otherwise.
int RunReplaced(const std::string& command, int argc, char** argv) {
  if (argc == 2 || IsHelp(argc - 1, argv + 1)) {
    std::cout << argv[1] << ": COLMAP's " << command << " with its options, "
              << (command == "feature_extractor" ? "and its features, in a fifth" : "but exact matches, in a fraction")
              << " of its time on the CPU." << std::endl;
  }
  lazyloc::ReplaceSift(lazyloc::MatchDescriptors);
  std::vector<std::string> words(argv, argv + argc);
  words[1] = command;
  const std::string option =
      command == "feature_extractor" ? lazyloc::kExtractionUseGpuOption : lazyloc::kMatchingUseGpuOption;
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
  const std::string name = command.rfind(kPrefix, 0) == 0 ? command.substr(kPrefix.size()) : "";
  if (kReplacedCommands.count(name) > 0) return RunReplaced(name, argc, argv);
  const auto run = command == "lazy_epoch"       ? lazyloc::RunLazyEpoch
                   : command == "lazy_indexer"   ? lazyloc::RunLazyIndexer
                   : command == "lazy_localizer" ? lazyloc::RunLazyLocalizer
                   : command == "lazy_merger"    ? lazyloc::RunLazyMerger
                                                 : nullptr;
  if (run == nullptr) return ColmapUpstreamMain(argc, argv);
  lazyloc::InitializeLogging(argv);
  return run(argc - 1, argv + 1);
}
