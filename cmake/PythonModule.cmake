# Builds the extension module of the Python package, build/python/_core.*.so. It contains COLMAP and our library and
# exports nothing but its entry point, so that it can be loaded beside other packages that contain COLMAP, Ceres or glog.
find_package(Python 3.11 REQUIRED COMPONENTS Interpreter Development.Module
  OPTIONAL_COMPONENTS Development.SABIModule)
execute_process(COMMAND "${Python_EXECUTABLE}" -m nanobind --cmake_dir
  OUTPUT_VARIABLE nanobind_ROOT OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
find_package(nanobind CONFIG REQUIRED)

# The stable ABI makes one module for every Python from 3.12; nanobind ignores it for older ones.
nanobind_add_module(lazyloc_python STABLE_ABI NB_STATIC
  src/colmap_lazyloc/python/conversions.cc
  src/colmap_lazyloc/python/python_localizer.cc
  src/colmap_lazyloc/python/module.cc)
target_link_libraries(lazyloc_python PRIVATE lazyloc_cli lazyloc_bridge)
lazyloc_set_properties(lazyloc_python)
# Makes these system headers, because our warnings are errors.
target_include_directories(lazyloc_python SYSTEM PRIVATE "${NB_DIR}/include" ${Python_INCLUDE_DIRS})
target_link_options(lazyloc_python PRIVATE "LINKER:--version-script=${PROJECT_SOURCE_DIR}/cmake/python_module.map")
set_target_properties(lazyloc_python PROPERTIES
  OUTPUT_NAME _core
  CXX_VISIBILITY_PRESET hidden
  VISIBILITY_INLINES_HIDDEN ON
  LIBRARY_OUTPUT_DIRECTORY "${PROJECT_BINARY_DIR}/python")
install(TARGETS lazyloc_python LIBRARY DESTINATION colmap_lazyloc COMPONENT python EXCLUDE_FROM_ALL)
