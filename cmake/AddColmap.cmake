# Adds COLMAP's source tree as a subproject, unpatched and without what a localizer does not need.
set(COLMAP_SOURCE_DIR "" CACHE PATH "COLMAP source tree to build against")
if(NOT EXISTS "${COLMAP_SOURCE_DIR}/src/colmap/exe/colmap.cc")
  message(FATAL_ERROR "COLMAP_SOURCE_DIR='${COLMAP_SOURCE_DIR}' holds no COLMAP source tree; "
    "scripts/setup.sh fetches one")
endif()
if(EXISTS "${COLMAP_SOURCE_DIR}/src/colmap/sensor/rig.h")
  message(FATAL_ERROR "COLMAP_SOURCE_DIR='${COLMAP_SOURCE_DIR}' is COLMAP 4.x; this version builds against 3.10 only")
endif()
foreach(feature CUDA GUI OPENGL CGAL TESTS UNINSTALL CCACHE)
  set(${feature}_ENABLED OFF CACHE BOOL "" FORCE)
endforeach()
set(LAZYLOC_COLMAP_INTERFACE colmap_3x)
add_subdirectory("${COLMAP_SOURCE_DIR}" "${PROJECT_BINARY_DIR}/colmap" EXCLUDE_FROM_ALL)

# COLMAP 3.10 asks for C++14, where its headers give vectors of Eigen types another allocator than in C++17: all that is
# linked together must be compiled to one standard.
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
lazyloc_raise_cxx_standard("${COLMAP_SOURCE_DIR}")
