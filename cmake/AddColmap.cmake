# Adds COLMAP: its source tree as a subproject if COLMAP_SOURCE_DIR is set, or else an installed COLMAP. The source tree
# stays unchanged. An installed COLMAP has the libraries, but not all sources of the program.
set(COLMAP_SOURCE_DIR "" CACHE PATH "COLMAP source tree to build against; empty: an installed COLMAP")

# Sets LAZYLOC_COLMAP_INTERFACE to the folder of bridge/ that supports this version of COLMAP.
function(lazyloc_select_interface version place)
  if(version MATCHES "^3\\.10([^0-9]|$)")
    set(interface colmap_3x)
  elseif(version MATCHES "^4\\.[0-2]([^0-9]|$)")
    set(interface colmap_4x)
  else()
    message(FATAL_ERROR "${place} is COLMAP ${version}; supported are 3.10 and 4.0 to 4.2")
  endif()
  message(STATUS "COLMAP ${version} in ${place} (bridge/${interface})")
  set(LAZYLOC_COLMAP_INTERFACE ${interface} PARENT_SCOPE)
endfunction()

# Compiles COLMAP as C++17 like our code. COLMAP 3.10 asks for C++14, with which its headers give vectors of Eigen types
# another allocator, so that the two could not be linked.
function(lazyloc_raise_cxx_standard directory)
  get_property(targets DIRECTORY "${directory}" PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    set_property(TARGET ${target} PROPERTY CXX_STANDARD ${CMAKE_CXX_STANDARD})
  endforeach()
  get_property(subdirectories DIRECTORY "${directory}" PROPERTY SUBDIRECTORIES)
  foreach(subdirectory IN LISTS subdirectories)
    lazyloc_raise_cxx_standard("${subdirectory}")
  endforeach()
endfunction()

# Compiles COLMAP's feature extraction and matching with a corrected copy of threading.h. In COLMAP 3.10, JobQueue::Stop
# sets its flag without the lock, so that a thread that has just read the flag can wait forever, and feature_extractor
# with it. COLMAP 4 does not.
function(lazyloc_lock_job_queue source)
  set(header colmap/util/threading.h)
  file(READ "${source}/${header}" text)
  set(stop "::Stop() {\n")
  string(REPLACE "${stop}  stop_ = true;" "${stop}  std::unique_lock<std::mutex> lock(mutex_);\n  stop_ = true;" corrected "${text}")
  if(NOT corrected STREQUAL text)
    file(CONFIGURE OUTPUT "${PROJECT_BINARY_DIR}/corrected/${header}" CONTENT "${corrected}" @ONLY)
    file(GLOB sources "${source}/colmap/controllers/feature_*.cc")
    set_property(SOURCE ${sources} TARGET_DIRECTORY colmap_controllers
      PROPERTY INCLUDE_DIRECTORIES "${PROJECT_BINARY_DIR}/corrected")
  endif()
endfunction()

if(COLMAP_SOURCE_DIR)
  if(NOT EXISTS "${COLMAP_SOURCE_DIR}/src/colmap/exe/colmap.cc")
    # Begins with a blank, because CMake would break the line.
    message(FATAL_ERROR " COLMAP_SOURCE_DIR='${COLMAP_SOURCE_DIR}' contains no COLMAP source tree; 'scripts/setup.sh source' "
      "fetches one")
  endif()
  file(STRINGS "${COLMAP_SOURCE_DIR}/CMakeLists.txt" version_line REGEX "^set\\(COLMAP_VERSION ")
  string(REGEX MATCH "[0-9]+\\.[0-9]+[^\"]*" version "${version_line}")
  lazyloc_select_interface("${version}" "COLMAP_SOURCE_DIR='${COLMAP_SOURCE_DIR}'")
  # Changes the defaults of COLMAP's options, because a localizer does not need these features. -D on the command line
  # wins.
  foreach(feature CUDA GUI OPENGL CGAL LSD TESTS UNINSTALL CCACHE ONNX DOWNLOAD)
    set(${feature}_ENABLED OFF CACHE BOOL "Option of COLMAP")
  endforeach()
  add_subdirectory("${COLMAP_SOURCE_DIR}" "${PROJECT_BINARY_DIR}/colmap" EXCLUDE_FROM_ALL)
  lazyloc_lock_job_queue("${COLMAP_SOURCE_DIR}/src")
  lazyloc_raise_cxx_standard("${COLMAP_SOURCE_DIR}")
else()
  set(module_path "${CMAKE_MODULE_PATH}")
  find_package(colmap CONFIG QUIET)
  set(CMAKE_MODULE_PATH "${module_path}")  # restored, because COLMAP 3.10 changes it
  if(NOT colmap_FOUND)
    message(FATAL_ERROR "No COLMAP: set COLMAP_SOURCE_DIR to a source tree (scripts/setup.sh fetches one), or colmap_DIR "
      "to the folder of an installed COLMAP's colmap-config.cmake")
  endif()
  lazyloc_select_interface("${COLMAP_VERSION}" "colmap_DIR='${colmap_DIR}'")
  # Gives the libraries the names that they have in the source tree.
  foreach(library controllers estimators feature geometry image math optim retrieval scene sensor sfm util vlfeat)
    add_library(colmap_${library} ALIAS colmap::colmap_${library})
  endforeach()
endif()
