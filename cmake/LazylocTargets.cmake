# Functions that make one static library and one test program per folder of src/colmap_lazyloc.

# Disables -Wmaybe-uninitialized, because GCC warns about small Eigen matrices that are initialized; sanitizers check
# this reliably.
set(LAZYLOC_WARNINGS -Wall -Wextra -Wshadow -Wpedantic -Werror -Wno-maybe-uninitialized)

# COLMAP is compiled without them, as for a release, so that ccache has it.
set(LAZYLOC_SANITIZERS "" CACHE STRING "Sanitizers for our code, e.g. address,undefined")

function(lazyloc_set_properties target)
  target_compile_features(${target} PUBLIC cxx_std_17)
  target_compile_options(${target} PRIVATE ${LAZYLOC_WARNINGS})
  target_include_directories(${target} PUBLIC
    "$<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src>" "$<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>")
  if(LAZYLOC_SANITIZERS)
    # Ends the program at the first error; has Eigen's checks of sizes too. Compiles faster with -O1.
    target_compile_options(${target} PRIVATE -fsanitize=${LAZYLOC_SANITIZERS} -fno-sanitize-recover=all
      -fno-omit-frame-pointer -O1 -g1 -UNDEBUG)
    # Checks indices of standard containers, and makes Eigen allocate as in Ceres, which is built without sanitizers.
    target_compile_definitions(${target} PRIVATE _GLIBCXX_ASSERTIONS EIGEN_MALLOC_ALREADY_ALIGNED=1)
    target_link_options(${target} PUBLIC -fsanitize=${LAZYLOC_SANITIZERS})
  endif()
endfunction()

# Makes the library of a folder, for example: lazyloc_library(rotation LINK lazyloc_math). Its sources are all of the
# folder, and those in SOURCES, but neither tests nor those in EXCEPT.
function(lazyloc_library folder)
  cmake_parse_arguments(ARG "" "" "SOURCES;EXCEPT;LINK" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS RELATIVE "${CMAKE_CURRENT_SOURCE_DIR}/${folder}" "${folder}/*.cc")
  list(FILTER sources EXCLUDE REGEX "_test\\.cc$")
  list(REMOVE_ITEM sources "" ${ARG_EXCEPT})
  list(APPEND sources ${ARG_SOURCES})
  list(TRANSFORM sources PREPEND "${folder}/")
  add_library(lazyloc_${folder} STATIC ${sources})
  target_link_libraries(lazyloc_${folder} PUBLIC ${ARG_LINK} Eigen3::Eigen)
  lazyloc_set_properties(lazyloc_${folder})
  # Lets the Python module contain the library without exporting its symbols.
  set_target_properties(lazyloc_${folder} PROPERTIES
    POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
endfunction()

# Makes the test program of a folder, for example: lazyloc_tests(rotation LINK lazyloc_testing). Its sources are all
# tests of the folder. The name of a test in ctest is rotation/Suite.Name.
function(lazyloc_tests folder)
  if(NOT LAZYLOC_TESTS)
    return()
  endif()
  cmake_parse_arguments(ARG "" "" "LINK" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS "${folder}/*_test.cc")
  add_executable(lazyloc_${folder}_test ${sources})
  target_link_libraries(lazyloc_${folder}_test PRIVATE lazyloc_${folder} ${ARG_LINK} GTest::gmock_main)
  lazyloc_set_properties(lazyloc_${folder}_test)
  gtest_discover_tests(lazyloc_${folder}_test TEST_PREFIX "${folder}/" DISCOVERY_TIMEOUT 60)
endfunction()
