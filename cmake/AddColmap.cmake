# Adds COLMAP's source tree as a subproject, unpatched and without what a localizer does not need.
set(COLMAP_SOURCE_DIR "" CACHE PATH "COLMAP source tree to build against")
if(NOT EXISTS "${COLMAP_SOURCE_DIR}/src/colmap/exe/colmap.cc")
  message(FATAL_ERROR "COLMAP_SOURCE_DIR='${COLMAP_SOURCE_DIR}' holds no COLMAP source tree; "
    "scripts/setup.sh fetches one")
endif()
foreach(feature CUDA GUI OPENGL CGAL TESTS UNINSTALL CCACHE)
  set(${feature}_ENABLED OFF CACHE BOOL "" FORCE)
endforeach()
set(LAZYLOC_COLMAP_INTERFACE colmap_3x)
add_subdirectory("${COLMAP_SOURCE_DIR}" "${PROJECT_BINARY_DIR}/colmap" EXCLUDE_FROM_ALL)
