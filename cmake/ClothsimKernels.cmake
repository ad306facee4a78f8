# The kernels of one instruction set, as object libraries. Only they are compiled for it: whatever else were in these files
# could be picked by the linker for every processor.
function(clothsim_add_kernels isa)
  string(JOIN " " flags ${ARGN})
  set(options clothsim_options_${isa})
  add_library(${options} INTERFACE)
  target_include_directories(${options} INTERFACE cpp)
  target_link_libraries(${options} INTERFACE clothsim_options xsimd)
  target_compile_options(${options} INTERFACE ${ARGN}
    -Wno-maybe-uninitialized -Wno-uninitialized)  # g++ 12 warns about its own _mm512_undefined_ps
  target_compile_definitions(${options} INTERFACE "CLOTHSIM_ISA=\"${isa}\"" "CLOTHSIM_ISA_FLAGS=\"${flags}\"")

  set(kernels clothsim_kernels_${isa})
  # What takes longest to compile is begun first.
  foreach(share RANGE 3 0 -1)
    foreach(real IN ITEMS float double)
      add_library(${kernels}_${real}_${share} OBJECT cpp/kernels/kernel_share.cpp)
      target_compile_definitions(${kernels}_${real}_${share} PRIVATE CLOTHSIM_REAL=${real} CLOTHSIM_SHARE=${share})
      list(APPEND libraries ${kernels}_${real}_${share})
    endforeach()
  endforeach()
  add_library(${kernels} OBJECT cpp/kernels/kernel_table.cpp cpp/kernels/contact_kernels.cpp)
  foreach(library IN ITEMS ${libraries} ${kernels})
    target_link_libraries(${library} PRIVATE ${options})
    set_target_properties(${library} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    target_sources(clothsim_core PRIVATE $<TARGET_OBJECTS:${library}>)
  endforeach()
endfunction()
