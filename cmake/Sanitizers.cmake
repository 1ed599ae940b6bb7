# Checks everything that is compiled, COLMAP too, with the sanitizers of LAZYLOC_SANITIZERS.
set(LAZYLOC_SANITIZERS "" CACHE STRING "Sanitizers for our code and COLMAP's, e.g. address,undefined")

if(LAZYLOC_SANITIZERS)
  # Uses -O1, and omits the checks of every member access, because both make COLMAP's build several times slower. Our
  # own targets have these checks (LazylocTargets.cmake).
  add_compile_options(-fsanitize=${LAZYLOC_SANITIZERS} -fno-sanitize=null,alignment,vptr,object-size
    -fno-omit-frame-pointer -O1 -g1)
  # Checks indices of standard containers, and makes Eigen allocate as in Ceres, which is built without sanitizers.
  add_compile_definitions(_GLIBCXX_ASSERTIONS EIGEN_MALLOC_ALREADY_ALIGNED=1)
  add_link_options(-fsanitize=${LAZYLOC_SANITIZERS})
endif()
