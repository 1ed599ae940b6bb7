#pragma once

namespace lazyloc {

// The command `colmap lazy_localizer`; argv[0] is the program. Returns its exit code: 0 for a run that ended, whatever
// the queries' statuses; 1 for bad options or files, nothing written; 2 with --strict if a query was not localized; 130
// after Ctrl-C, with the results so far written.
int RunLazyLocalizer(int argc, char** argv);

}  // namespace lazyloc
