#!/usr/bin/env bash
# Checks the rules in CONTRIBUTING.md on the form of the code: layout, layers, links, tables, Python, and by clang-tidy the
# C++ files that have changed.
# It builds nothing, and takes a few seconds, and half a minute for each changed C++ file.
#
#   BASE    commit since which files count as changed; default: the branch's upstream, without one the last commit
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/setup.sh environment
source scripts/environment.sh

failed=()

# Runs one check; its output is shown only if it fails.
check() {
  local name=$1 log
  shift
  if log=$("$@" 2>&1); then
    printf 'check: %-11s %s\n' "$name" "$(tail -n 1 <<< "$log")"
  else
    printf '%s\ncheck: %s failed\n' "$log" "$name" >&2
    failed+=("$name")
  fi
}

check_layout() {
  git ls-files -z --cached --others --exclude-standard '*.h' '*.cc' |
    xargs -0 -n 32 -P "$(nproc)" "$VENV_DIR/bin/clang-format" --dry-run --Werror && echo "clang-format: 0 problem(s)"
}

# Runs clang-tidy on the C++ files that differ from those of BASE; of a header, on the source file of the same name.
check_tidy() {
  local base database=$BUILD_DIR/compile_commands.json file files=()
  command -v clang-tidy > /dev/null || { echo "skipped: clang-tidy is not installed"; return; }
  [ -f "$database" ] || { echo "skipped: $database is missing; scripts/setup.sh makes it"; return; }
  if [ -n "${BASE:-}" ] || git rev-parse --quiet --verify '@{upstream}' > /dev/null; then
    base=$(git merge-base HEAD "${BASE:-@{upstream\}}") || return 1
  else
    base=HEAD
  fi
  for file in $({ git diff --name-only "$base" -- 'src/*.cc' 'src/*.h'
                  git ls-files --others --exclude-standard 'src/*.cc' 'src/*.h'; } | sed 's/\.h$/.cc/' | sort -u); do
    ! grep -q "/$file\"" "$database" || files+=("$file")
  done
  [ ${#files[@]} -eq 0 ] || printf '%s\0' "${files[@]}" |
    xargs -0 -n 1 -P "$(nproc)" clang-tidy --quiet -p "$BUILD_DIR" || return 1
  echo "clang-tidy: 0 problem(s), ${#files[@]} changed files"
}

check layout check_layout
for name in layers links tables; do
  check "$name" "$PYTHON" "scripts/checks/$name.py"
done
check ruff "$VENV_DIR/bin/ruff" check .
check "ruff format" "$VENV_DIR/bin/ruff" format --check .

check clang-tidy check_tidy

[ ${#failed[@]} -eq 0 ] || { echo "check: failed: ${failed[*]}" >&2; exit 1; }
