# Defines the library colmap_lazyloc::colmap_lazyloc, which localizes queries from data structures. Installs it with
# headers and a CMake package only if COLMAP is an installed one, because that package depends on COLMAP's package.
set(LAZYLOC_LIBRARY_FOLDERS
  math scene bridge two_view rotation translation structure refinement
  group noise uncertainty initialization paper depths intrinsics priors pipeline)
list(TRANSFORM LAZYLOC_LIBRARY_FOLDERS PREPEND lazyloc_ OUTPUT_VARIABLE library_targets)

add_library(colmap_lazyloc INTERFACE)
add_library(colmap_lazyloc::colmap_lazyloc ALIAS colmap_lazyloc)
target_link_libraries(colmap_lazyloc INTERFACE lazyloc_pipeline)

if(COLMAP_SOURCE_DIR)
  return()
endif()
include(CMakePackageConfigHelpers)
set(package_dir "${CMAKE_INSTALL_LIBDIR}/cmake/colmap_lazyloc")
install(TARGETS colmap_lazyloc ${library_targets} EXPORT colmap_lazyloc-targets)
install(EXPORT colmap_lazyloc-targets NAMESPACE colmap_lazyloc:: DESTINATION "${package_dir}")
foreach(folder IN LISTS LAZYLOC_LIBRARY_FOLDERS)
  install(DIRECTORY "${PROJECT_SOURCE_DIR}/src/colmap_lazyloc/${folder}"
    DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}/colmap_lazyloc"
    FILES_MATCHING PATTERN "*.h"
    PATTERN "*_test_*" EXCLUDE PATTERN "convert.h" EXCLUDE PATTERN "*_ransac.h" EXCLUDE
    PATTERN "database_writing.h" EXCLUDE PATTERN "sift*.h" EXCLUDE)
endforeach()
configure_package_config_file(cmake/colmap_lazyloc-config.cmake.in "${PROJECT_BINARY_DIR}/colmap_lazyloc-config.cmake"
  INSTALL_DESTINATION "${package_dir}")
write_basic_package_version_file("${PROJECT_BINARY_DIR}/colmap_lazyloc-config-version.cmake"
  COMPATIBILITY SameMinorVersion)
install(FILES
  "${PROJECT_BINARY_DIR}/colmap_lazyloc-config.cmake" "${PROJECT_BINARY_DIR}/colmap_lazyloc-config-version.cmake"
  DESTINATION "${package_dir}")
