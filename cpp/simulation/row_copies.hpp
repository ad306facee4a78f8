// A row of mass points between an array of (x, y, z) and the engines' layouts, vectorised: first the arithmetic on the
// row as it stands, then a transposition that moves elements only.
#pragma once

#include <cstddef>

namespace clothsim {

// high + low = x + shift, `low` being what rounding to single takes; `low` may be null. A shift of -0 changes nothing.
void split(const double* x, const double* shift, double* high, double* low, int count);
void split(const float* x, const double* shift, double* high, double* low, int count);
void split(const double* x, const double* shift, float* high, float* low, int count);
void split(const float* x, const double* shift, float* high, float* low, int count);

// x = high + low + shift.
void join(const double* high, const double* low, const double* shift, double* x, int count);
void join(const double* high, const double* low, const double* shift, float* x, int count);
void join(const float* high, const float* low, const double* shift, double* x, int count);
void join(const float* high, const float* low, const double* shift, float* x, int count);

// (x, y, z) of every column to three planes, and back.
template <class Real>
void to_planes(const Real* row, Real* planes, std::ptrdiff_t plane, int columns);
template <class Real>
void from_planes(const Real* planes, std::ptrdiff_t plane, Real* row, int columns);

// Where the elements of a row stand in row-lifted records (see cpp/kernels/edge_impl.hpp): component c of column
// l vectors + k is lane l of the vector at place[3 k + c].
struct LiftedRow {
    int columns, lanes, vectors;
    const std::ptrdiff_t* place;
};
template <class Real>
void to_lanes(const Real* row, Real* records, const LiftedRow& lifted);
template <class Real>
void from_lanes(const Real* records, Real* row, const LiftedRow& lifted);

// To memory past the caches: nothing there makes room for it, and what it replaces is not fetched first.
void copy_past_caches(const void* from, void* to, std::size_t bytes);

// Smallest and largest of each component of `points` points.
void extent(const double* x, std::ptrdiff_t points, double (&low)[3], double (&high)[3]);
void extent(const float* x, std::ptrdiff_t points, double (&low)[3], double (&high)[3]);

}  // namespace clothsim
