"""Lists the files that a check reads, and prints its findings in the same form for all checks."""

import argparse
import pathlib
import subprocess
import sys


def parse_root(description):
    """Parses the command line that all checks share and returns the folder to check."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--root",
        type=pathlib.Path,
        default=pathlib.Path(__file__).resolve().parents[2],
        help="folder to check; default: this checkout",
    )
    return parser.parse_args().root


def list_files(root, *patterns):
    """Returns the files below the root that match a pattern, sorted; without ignored files in a git checkout."""
    if (root / ".git").exists():
        command = ["git", "-C", root, "ls-files", "--cached", "--others", "--exclude-standard", "-z", *patterns]
        names = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split("\0")
        paths = {root / name for name in names if name}
    else:
        paths = {path for pattern in patterns for path in root.rglob(pattern)}
    return sorted(path for path in paths if path.is_file())


def finish(name, problems, summary):
    """Prints the problems, one per line, and ends the program; the exit code is 1 if there are any."""
    for problem in problems:
        print(problem, file=sys.stderr)
    print(f"{name}: {len(problems)} problem(s), {summary}")
    sys.exit(1 if problems else 0)
