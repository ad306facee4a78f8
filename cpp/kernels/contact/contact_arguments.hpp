// Input and output of the pass for continuous contact. Plain data, shared by portable and per-instruction-set
// files.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/contact/continuous.hpp"

namespace clothsim {

// A layout seen as rows of vectors: component k of vector j of row i lies at i * row + j * vector + k *
// component. Both engines' layouts have this form.
struct VectorGeometry {
    std::ptrdiff_t row, vector, component;
    std::ptrdiff_t compensation;  // from a value to what rounding took from it; 0: not compensated
    int rows, vectors;
};

// Marks that the kernel leaves at a vector: it still has to go to `before`; the kernel has responded to one
// of its points.
inline constexpr std::uint8_t vector_unresolved = 1, vector_responded = 2;

template <class Real>
struct ContactArguments {
    VectorGeometry geometry;
    Real* state;
    Real* before;  // the state at the start of the step, in the same layout
    const std::uint64_t* free;  // a bit a lane, a value a vector, row by row: 0 for pinned and padding points
    std::uint8_t* open;  // a value a vector, row by row: of the marks above
    const SweptSphere* spheres;
    int sphere_count;
    const Real* mass;  // a value a lane, vector by vector [kg]
    double*
        impulses;  // on the sphere, if it is one: x, y and z of a row, `impulse_row` from row to row [N s]
    std::ptrdiff_t impulse_row;
    bool bounces;  // whether velocities before the step are needed; those of `before` are old otherwise
    // Points without a response here: those whose bounce flies; all that are near if there are several
    // spheres; pinned points in a sphere.
    void (*unresolved)(void* context, int row, int vector, std::uint64_t lanes);
    void* context;
};

}  // namespace clothsim
