// Sums of a state and accelerations, element by element: what is left of an integrator once the forces are
// known. Nothing is fused or reordered, so every instruction set gives the same bits.
#pragma once

#include <array>

#include "memory/field.hpp"

namespace clothsim {

// dx = drift v + sum x_l a_l,  dv = sum v_l a_l
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

// Rows [begin, end) of `to` become those of `from` plus the combination; `to` may be `from`. A compensated
// state keeps what rounding takes.
void advance_rows(const FieldLayout& field, int begin, int end, const float* from, float* to,
                  const Combination<float>& sum);
void advance_rows(const FieldLayout& field, int begin, int end, const double* from, double* to,
                  const Combination<double>& sum);

// Sums of squares of dx and of dv over each row, for its own whichever rows there are; `state` gives the
// velocities.
struct RowSquares {
    double x = 0, v = 0;
};
void square_rows(const FieldLayout& field, int begin, int end, const float* state,
                 const Combination<float>& sum, RowSquares* rows);
void square_rows(const FieldLayout& field, int begin, int end, const double* state,
                 const Combination<double>& sum, RowSquares* rows);

}  // namespace clothsim
