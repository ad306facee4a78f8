# Eigen and xsimd are headers that the build environment brings as Python packages: cmeel-eigen with
# its own CMake package, xsimd inside the wheel of pythran. A system copy is taken where there is
# one.
execute_process(
  COMMAND ${Python_EXECUTABLE} -c "import sysconfig; print(sysconfig.get_paths()['purelib'])"
  OUTPUT_VARIABLE CLOTHSIM_SITE_PACKAGES OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)

# An isolated build keeps its packages on sys.path, not in the interpreter's own folder.
execute_process(
  COMMAND ${Python_EXECUTABLE} -c "import sys; print(';'.join(p for p in sys.path if 'site-packages' in p))"
  OUTPUT_VARIABLE CLOTHSIM_PACKAGE_FOLDERS OUTPUT_STRIP_TRAILING_WHITESPACE)
list(PREPEND CLOTHSIM_PACKAGE_FOLDERS ${CLOTHSIM_SITE_PACKAGES})

foreach(folder IN LISTS CLOTHSIM_PACKAGE_FOLDERS)
  list(APPEND CMAKE_PREFIX_PATH ${folder}/cmeel.prefix)
endforeach()
find_package(Eigen3 3.4 REQUIRED NO_MODULE)

find_package(xsimd 13 QUIET)
if(NOT TARGET xsimd)
  list(TRANSFORM CLOTHSIM_PACKAGE_FOLDERS APPEND /pythran OUTPUT_VARIABLE folders)
  find_path(CLOTHSIM_XSIMD_INCLUDE_DIR xsimd/xsimd.hpp PATHS ${folders} REQUIRED)
  add_library(xsimd INTERFACE)
  target_include_directories(xsimd SYSTEM INTERFACE ${CLOTHSIM_XSIMD_INCLUDE_DIR})
endif()
