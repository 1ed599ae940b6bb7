# Settings of a build by pip, which passes no arguments: COLMAP's source tree is the one that scripts/setup.sh fetches,
# or the one that the environment variable COLMAP_SOURCE_DIR names. The headers of ONNX Runtime are those that the script
# fetches, and ccache serves what it has compiled.
set(cache "$ENV{XDG_CACHE_HOME}")
if(NOT cache)
  set(cache "$ENV{HOME}/.cache")
endif()
set(source "$ENV{COLMAP_SOURCE_DIR}")
if(NOT source)
  set(source "${cache}/colmap_lazyloc/colmap-debian-13")
endif()
set(COLMAP_SOURCE_DIR "${source}" CACHE PATH "COLMAP source tree to build against")
find_path(ONNXRUNTIME_INCLUDE_DIR onnxruntime_c_api.h HINTS "${cache}/colmap_lazyloc/onnxruntime-headers")
find_program(LAZYLOC_CCACHE ccache)
if(LAZYLOC_CCACHE)
  set(CMAKE_C_COMPILER_LAUNCHER "${LAZYLOC_CCACHE}")
  set(CMAKE_CXX_COMPILER_LAUNCHER "${LAZYLOC_CCACHE}")
endif()
