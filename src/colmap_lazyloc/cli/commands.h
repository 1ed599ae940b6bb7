#pragma once

namespace lazyloc {

// Run a command of the colmap program; argv[0] is the program. Return its exit code: 0, or 1 for bad options or files,
// and then nothing is written.
int RunLazyEpoch(int argc, char** argv);
int RunLazyIndexer(int argc, char** argv);
int RunLazyMerger(int argc, char** argv);

// Returns 0 if the run ended, whatever the queries' statuses; 1 as above; 2 with --strict if a query was not localized;
// 130 after Ctrl-C, and the results so far are written.
int RunLazyLocalizer(int argc, char** argv);

}  // namespace lazyloc
