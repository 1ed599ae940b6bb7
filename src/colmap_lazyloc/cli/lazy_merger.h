#pragma once

namespace lazyloc {

// Runs the command `colmap lazy_merger`; argv[0] is the program. Returns its exit code: 0, or 1 for bad options or
// files, and nothing is written.
int RunLazyMerger(int argc, char** argv);

}  // namespace lazyloc
