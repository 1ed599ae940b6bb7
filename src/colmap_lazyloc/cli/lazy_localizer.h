#pragma once

namespace lazyloc {

// Runs the command `colmap lazy_localizer`; argv[0] is the program. Returns its exit code: 0 if the run ended, whatever
// the queries' statuses; 1 for bad options or files, and nothing is written; 2 with --strict if a query was not
// localized; 130 after Ctrl-C, and the results so far are written.
int RunLazyLocalizer(int argc, char** argv);

}  // namespace lazyloc
