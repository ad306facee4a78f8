# One object library per instruction set. Only the kernels are compiled for it: whatever else were in these
# files could be picked by the linker for every processor.
function(clothsim_add_kernels isa)
  add_library(clothsim_kernels_${isa} OBJECT cpp/kernels/kernels_${isa}.cpp
    cpp/kernels/kernels_${isa}_double.cpp cpp/kernels/contact_${isa}.cpp)
  target_include_directories(clothsim_kernels_${isa} PRIVATE cpp)
  target_link_libraries(clothsim_kernels_${isa} PRIVATE clothsim_options xsimd)
  target_compile_options(clothsim_kernels_${isa} PRIVATE ${ARGN}
    -Wno-maybe-uninitialized -Wno-uninitialized)  # g++ 12 warns about its own _mm512_undefined_ps
  string(JOIN " " flags ${ARGN})
  target_compile_definitions(clothsim_kernels_${isa} PRIVATE "CLOTHSIM_ISA_FLAGS=\"${flags}\"")
  set_target_properties(clothsim_kernels_${isa} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  target_sources(clothsim_core PRIVATE $<TARGET_OBJECTS:clothsim_kernels_${isa}>)
endfunction()
