// Rows of a state or of accelerations as they lie in an engine's memory, and what the kernels do
// with them whatever the springs are: extents, sums of integrators, whether numbers are finite.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace clothsim {

// One component of the mass points of some rows.
template <class Real>
struct ComponentRows {
    const Real* first;
    std::ptrdiff_t row, vector;  // elements from one to the next
    int rows, vectors;
};

// A layout seen as rows of vectors: component k of vector j of row i lies at i * row + j * vector +
// k * component. Both engines' layouts have this form.
struct VectorGeometry {
    std::ptrdiff_t row, vector, component;
    int rows, vectors;
};

// Places d from `place` with d.(2 n + k d) < below lie below a level of a sphere or plane.
template <class Real>
struct SurfaceLevel {
    Real place[3], normal[3], curvature, below;
};

template <class Real>
struct Extent {
    Real low, high;
};

// Spans of `size` elements, a multiple of a vector, and `stride` from one to the next.
struct Spans {
    std::ptrdiff_t count, size, stride;
};

// Layout of states and accelerations of an engine, as far as the integrators need it. A row is
// `runs` runs of `length` elements of x, each with its run of v and of the acceleration. Padding is
// part of a run. Its velocity and acceleration are 0, so it stays in place.
struct FieldLayout {
    int runs, length;
    // Elements of a state array: from the start to row 0, from row to row, from run to run, from x
    // to v. The last is from a value to its compensation (0: not compensated).
    std::ptrdiff_t origin, row, run, velocity, compensation;
    // The same of accelerations, and how many elements a slope takes.
    std::ptrdiff_t acceleration_origin, acceleration_row, acceleration_run, acceleration_size;
};

// The sum dx = drift v + sum x_l a_l,  dv = sum v_l a_l.
template <class Real>
struct Combination {
    static constexpr int most = 16;  // slopes in a sum: room for the largest method
    Real drift = 0;
    int count = 0;
    std::array<const Real*, most> a{};
    std::array<Real, most> x{}, v{};

    void add(const Real* acceleration, double in_x, double in_v) {
        if (in_x == 0 && in_v == 0) return;
        a[std::size_t(count)] = acceleration;
        x[std::size_t(count)] = Real(in_x);
        v[std::size_t(count)] = Real(in_v);
        ++count;
    }
};

// An increment (dx, dv) of a Chebyshev recurrence, or one of its errors, times a scale:
//
//     last d_last + before d_before + slope (v + dv_last, a_last) + first_slope (v, a_first)
template <class Real>
struct ChebyshevSum {
    Real last = 0;
    Real before = 0;
    Real slope = 0, first_slope = 0;  // s
    const Real *a_last = nullptr, *a_first = nullptr;
    Real scale_x = 1;
    Real scale_v = 1;
};

// Sums of squares of dx and of dv over a row.
struct RowSquares {
    double x = 0;
    double v = 0;
};

// How a row lies in an engine's layout: column l `vectors` + k is lane l of vector k.
struct RowShape {
    int columns, lanes, vectors;
    std::ptrdiff_t vector, component;  // elements from one to the next
};

template <class Real>
struct RowsKernels {
    // Returns the lanes of a vector of points that are below a level, a bit each.
    std::uint64_t (*below)(const Real* points, std::ptrdiff_t component, const SurfaceLevel<Real>&);
    // Returns the smallest and the largest value; what is no number does not count.
    Extent<Real> (*extent)(const ComponentRows<Real>&);
    bool (*all_finite)(const Real*, const Spans&);
    // Rows [begin, end) of `to` become those of `from` plus the combination; `to` may be `from`. A
    // compensated state keeps what rounding takes.
    void (*advance)(const FieldLayout&, int begin, int end, const Real* from, Real* to,
                    const Combination<Real>&);
    // `state` gives the velocities.
    void (*square)(const FieldLayout&, int begin, int end, const Real* state,
                   const Combination<Real>&, RowSquares*);
    // The sum of increments of rows [begin, end), which has the layout of the state `from`, takes
    // the place of `before`, and `from` plus the sum goes to `to`, compensated as by `advance`. An
    // increment whose factor is 0 is not read.
    void (*chebyshev)(const FieldLayout&, int begin, int end, const Real* from, const Real* last,
                      Real* before, Real* to, const ChebyshevSum<Real>&);
    // Returns the squares of the sum, without `before`.
    void (*chebyshev_square)(const FieldLayout&, int begin, int end, const Real* from,
                             const Real* last, const ChebyshevSum<Real>&, RowSquares*);
    // Writes a row of a state to arrays of shape (points, 3): positions, to which the origin is
    // added, and velocities.
    void (*read_points)(const Real* row, const RowShape&, const double* origin, double* x,
                        double* v);
    // Writes three components of a row: `values` times the scale of each point, plus other values;
    // null: none.
    void (*write_points)(const double* values, const double* scale, const double* plus,
                         const RowShape&, Real* row);
};

}  // namespace clothsim
