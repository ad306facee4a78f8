# The kernels of one instruction set, as object libraries. Only they are compiled for it: whatever else were in these files
# could be picked by the linker for every processor. EDGE_IN_VERSIONS: besides the edge kernel's loop for every cloth those for sets
# of families and stages, which take most of the time to compile.
function(clothsim_add_kernels isa)
  cmake_parse_arguments(PARSE_ARGV 1 arg "EDGE_IN_VERSIONS" "" "")
  string(JOIN " " flags ${arg_UNPARSED_ARGUMENTS})
  set(options clothsim_options_${isa})
  add_library(${options} INTERFACE)
  target_include_directories(${options} INTERFACE cpp)
  target_link_libraries(${options} INTERFACE clothsim_options xsimd)
  target_compile_options(${options} INTERFACE ${arg_UNPARSED_ARGUMENTS})
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND isa STREQUAL "avx512")  # g++ 12 warns about its own _mm512_undefined_ps
    target_compile_options(${options} INTERFACE -Wno-maybe-uninitialized -Wno-uninitialized)
  endif()
  target_compile_definitions(${options} INTERFACE "CLOTHSIM_ISA=\"${isa}\"" "CLOTHSIM_ISA_FLAGS=\"${flags}\"")

  set(kernels clothsim_kernels_${isa})
  add_library(${kernels} OBJECT cpp/kernels/kernel_table.cpp cpp/kernels/state_row_kernels.cpp cpp/kernels/contact/contact_kernels.cpp
    cpp/kernels/contact/face_kernels.cpp)
  if(arg_EDGE_IN_VERSIONS)
    target_compile_definitions(${options} INTERFACE CLOTHSIM_EDGE_IN_VERSIONS)
    # The shares of kernel_table.hpp (edge_share_count). Those that take longest to compile are begun first.
    foreach(share RANGE 3 0 -1)
      foreach(real IN ITEMS float double)
        add_library(${kernels}_${real}_${share} OBJECT cpp/kernels/edge/edge_share.cpp)
        target_compile_definitions(${kernels}_${real}_${share} PRIVATE CLOTHSIM_REAL=${real} CLOTHSIM_SHARE=${share})
        list(APPEND libraries ${kernels}_${real}_${share})
      endforeach()
    endforeach()
  endif()
  foreach(library IN ITEMS ${libraries} ${kernels})
    target_link_libraries(${library} PRIVATE ${options})
    set_target_properties(${library} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    target_sources(clothsim_core PRIVATE $<TARGET_OBJECTS:${library}>)
  endforeach()
endfunction()
