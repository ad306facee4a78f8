# The kernels of one instruction set, as object libraries. Only they are compiled for it: whatever
# else were in these files could be picked by the linker for every processor. EDGE_IN_VERSIONS:
# besides the edge kernel's loop for every cloth those for sets of families and stages, which take
# most of the time to compile.
function(clothsim_add_kernels isa)
  cmake_parse_arguments(PARSE_ARGV 1 arg "EDGE_IN_VERSIONS" "" "")
  string(JOIN " " flags ${arg_UNPARSED_ARGUMENTS})
  set(options clothsim_options_${isa})
  add_library(${options} INTERFACE)
  target_include_directories(${options} INTERFACE cpp)
  target_link_libraries(${options} INTERFACE clothsim_options xsimd)
  target_compile_options(${options} INTERFACE ${arg_UNPARSED_ARGUMENTS})
  # g++ 12 warns about its own _mm512_undefined_ps.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND isa STREQUAL "avx512")
    target_compile_options(${options} INTERFACE -Wno-maybe-uninitialized -Wno-uninitialized)
  endif()
  target_compile_definitions(${options} INTERFACE "CLOTHSIM_ISA=\"${isa}\"" "CLOTHSIM_ISA_FLAGS=\"${flags}\"")

  set(kernels clothsim_kernels_${isa})
  add_library(${kernels} OBJECT cpp/kernels/kernel_table.cpp)
  if(arg_EDGE_IN_VERSIONS)
    target_compile_definitions(${options} INTERFACE CLOTHSIM_EDGE_IN_VERSIONS)
    # The parts of kernel_table.hpp (edge_part_count). Those that take longest to compile are begun
    # first.
    foreach(part RANGE 3 0 -1)
      foreach(real IN ITEMS float double)
        add_library(${kernels}_${real}_${part} OBJECT cpp/kernels/edge/edge_part.cpp)
        target_compile_definitions(${kernels}_${real}_${part} PRIVATE CLOTHSIM_REAL=${real} CLOTHSIM_PART=${part})
        list(APPEND libraries ${kernels}_${real}_${part})
      endforeach()
    endforeach()
  endif()
  if(CLOTHSIM_PRECOMPILE)
    target_precompile_headers(${kernels} PRIVATE cpp/lanes/lanes.hpp)
    foreach(library IN LISTS libraries)
      target_precompile_headers(${library} REUSE_FROM ${kernels})
    endforeach()
  endif()
  foreach(library IN ITEMS ${libraries} ${kernels})
    target_link_libraries(${library} PRIVATE ${options})
    set_target_properties(${library} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    target_sources(clothsim_core PRIVATE $<TARGET_OBJECTS:${library}>)
  endforeach()
endfunction()
