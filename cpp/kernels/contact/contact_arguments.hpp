// Input and output of the contact pass. Plain data, shared by portable and per-instruction-set
// files.
#pragma once

#include <cstddef>
#include <cstdint>

namespace clothsim {

// A sphere over one step, prepared for many points (contact/continuous.hpp).
struct SweptSphere {
    double start[3], end[3];  // p0 [m]
    double velocity[3];  // (end - start) / dt [m/s]
    double normal[3], curvature;  // n, k [1/m]
    double size;  // the radius, or less: points are expected this near p0 [m]
    // Levels [m]: a point was inside if it began below `innermost`. None may end below `least`. A
    // response puts it on top of a band over that, and it may lie anywhere within.
    double innermost, least, band;
    bool cells;  // each point keeps the level k rho^2 more, but no more than `most_of_cells`
    double most_of_cells;
    // Of the check for points that may respond (contact_impl.hpp).
    double near_level, near_curvature;
    double tolerance;  // see ContactBand [m]
    double restitution, friction;
    double push;  // how far a point that was inside is pushed outwards in a step, at most [m]
    double dt;
};

// Bands [of the size].
struct ContactBand {
    // Without cells, as a level in epsilon; rounding of a level is up to 5 epsilon.
    static constexpr double least = 8;
    // Points that lie so far above the top, as a level in epsilon, rest there: sliding on a sphere
    // raises them. With half of it more of them go to the slower path; twice is seen in "single".
    static constexpr double tolerance = 16;
    // With cells, as lengths. In double it is bounded by a part of what a cell at rest adds to the
    // radius. With half of it a violent impact takes more rounds, with twice as much points stand
    // off farther by another millionth.
    static constexpr double of_cells = 1e-6, least_of_cells = 64 * 0x1p-52,
                            of_cells_in_single = 8e-6;
    // Half: more rounds on large spheres. Twice: points stand off by another hundredth.
    static constexpr double part_of_cell = 0.01;
    // Rounding of rho^2 in the kernels, in epsilon; found by comparison with 64 bits of mantissa:
    // up to 9.
    static constexpr double rounding_of_cells = 32;
    // Circles around three corners that exceed the largest circle on two by less are not computed,
    // but covered. Cells of a cloth that lies smoothly have such circles. A part of rho^2. With
    // half of it more circles are computed, with twice as much points stand off farther by another
    // 1e-4 of their stand-off.
    static constexpr double excess = 1e-4;
};
template <class Real>
inline constexpr double cell_rounding = 1 + ContactBand::excess +
    ContactBand::rounding_of_cells * (sizeof(Real) == 4 ? 0x1p-23 : 0x1p-52);

// A layout seen as rows of vectors: component k of vector j of row i lies at i * row + j * vector +
// k * component. Both engines' layouts have this form.
struct VectorGeometry {
    std::ptrdiff_t row, vector, component;
    std::ptrdiff_t compensation;  // from a value to what rounding took from it; 0: not compensated
    int rows, vectors;
};

// Marks of a row of points: some may touch a sphere; some were changed; some are to be resolved one
// by one; some were lifted.
struct ContactMarks {
    static constexpr std::uint8_t near = 1, responded = 2, unresolved = 4, lifted = 8;
};

// Values of points and cells are arrays of their own: lane l of vector j of row i at (i * vectors +
// j) * lanes + l. Sets of points are a bit a lane, a value a vector. The cell of a point lies
// between it, its neighbour to the right and the two below.
template <class Real>
struct ContactArguments {
    VectorGeometry geometry;
    Real* state;
    Real* before;  // the state at the start of the step, in the same layout
    const SweptSphere* spheres;
    int sphere_count;
    const std::uint64_t* free;  // points that are neither pinned nor padding
    const Real* mass;  // [kg]
    // On each sphere: x, y and z of a row, `impulse_row` from row to row [N s].
    double* const* impulses;
    std::ptrdiff_t impulse_row;
    // Whether velocities before the step are needed; those of `before` are old otherwise.
    bool bounces;
    std::uint8_t* marks;  // a value a row: ContactMarks
    std::uint64_t* near;  // points that may touch a sphere, a set for each sphere
    std::uint64_t* unresolved;  // points that the pass resolves one by one
    std::uint64_t* inside;  // points that began inside
    // Offset "cell".
    bool cells;
    bool first_round;  // of lifts
    // From a vector to its right-hand neighbours, and of the last of a row; from a row to the next
    // [elements].
    std::ptrdiff_t right, right_of_last, below;
    bool transposed;  // the left-hand neighbours of vector 0 are the last vector's, a lane further
    const std::uint64_t* cell_lanes;  // whether the cell is one
    Real* cell_radii2;  // rho^2 of the cells [m^2]; an element before the first may be read
    Real* point_radii2;  // the largest of a near point's cells, before the step [m^2]
    Real* press;  // of a near point: speed that a contact from the start of the step on took [m/s]
    const std::uint8_t* wanted;  // rows of cells whose rho is needed
    double* lift_work;  // a value a row: of lifts, times the step [J s]
};

}  // namespace clothsim
