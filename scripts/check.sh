#!/usr/bin/env bash
# Checks the rules in CONTRIBUTING.md on the form of the code: layout, layers, sizes, Python, links,
# comments, prose, tables.
# It takes a few seconds and builds nothing.
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
    printf 'check: %-10s %s\n' "$name" "$(tail -n 1 <<< "$log")"
  else
    printf '%s\ncheck: %s failed\n' "$log" "$name" >&2
    failed+=("$name")
  fi
}

# Succeeds if pyproject.toml has ruff's section of this name.
configures() {
  [ -f pyproject.toml ] && grep -q "^\[tool\.$1" pyproject.toml
}

check_layout() {
  git ls-files -z --cached --others --exclude-standard '*.h' '*.cc' |
    xargs -0 -n 32 -P "$(nproc)" "$VENV_DIR/bin/clang-format" --dry-run --Werror && echo "clang-format: 0 problem(s)"
}

check layout check_layout
for name in layers sizes links comments prose tables; do
  check "$name" "$PYTHON" "scripts/checks/$name.py"
done
if configures ruff; then check ruff "$VENV_DIR/bin/ruff" check --quiet .; fi
if configures ruff.format; then check "ruff format" "$VENV_DIR/bin/ruff" format --check --quiet .; fi

[ ${#failed[@]} -eq 0 ] || { echo "check: failed: ${failed[*]}" >&2; exit 1; }
