#!/usr/bin/env bash
# Runs Python with the package of this checkout, python/colmap_lazyloc, in the environment that scripts/setup.sh makes.
#
#   scripts/python.sh -m colmap_lazyloc.upgrade_database database.db
#
# PYTHON: another interpreter to use; default: the one of that environment.
set -euo pipefail
PYTHON=${PYTHON:-${XDG_CACHE_HOME:-$HOME/.cache}/colmap_lazyloc/venv/bin/python}
PYTHONPATH=$(dirname "$(realpath "$0")")/../python${PYTHONPATH:+:$PYTHONPATH} exec "$PYTHON" "$@"
