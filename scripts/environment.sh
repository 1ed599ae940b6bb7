# Sets the paths that the scripts use. Source it from the project's root.
CACHE_DIR=${XDG_CACHE_HOME:-$HOME/.cache}/colmap_lazyloc
DEBIAN_COLMAP_SOURCE_DIR=$CACHE_DIR/colmap-debian-13
COLMAP_SOURCE_DIR=${COLMAP_SOURCE_DIR:-$DEBIAN_COLMAP_SOURCE_DIR}
ONNXRUNTIME_INCLUDE_DIR=$CACHE_DIR/onnxruntime-headers
BUILD_DIR=${BUILD_DIR:-$PWD/build}
VENV_DIR=$CACHE_DIR/venv
PYTHON=$VENV_DIR/bin/python
PROJECT_VERSION=$(sed -n 's/^__version__ = "\(.*\)"/\1/p' python/colmap_lazyloc/__init__.py)
COLMAP=$BUILD_DIR/bin/colmap
# Use the package of this checkout, because several checkouts share the Python environment.
export PYTHONPATH=$PWD/python${PYTHONPATH:+:$PYTHONPATH}
# Let ccache serve what another checkout has compiled.
export CCACHE_BASEDIR=$PWD CCACHE_NOHASHDIR=1
