// The edge kernel's rows of two vectors with structural and shear springs. Forces for the next row stay in
// registers; with second neighbours too few registers would be left. The sums are the same as in `edge_row`,
// and so are the bits. But the springs past the row's end come first, so that the stage of the first vector
// is finished in its own row. For processors that take a vector in two halves; a processor that takes it at
// once is faster with `edge_row` (forwards_in_registers).
#pragma once

#include "kernels/edge/edge_update.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {
namespace {

// One stage of rows [begin, end). None is pending when it returns.
template <class Arch, class Real, bool damped, Stage stage>
__attribute__((noinline)) void edge_rows_of_two(EdgeArguments<Real>& e, int begin, int end) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    const std::ptrdiff_t stride = source_stride<V>(stage);
    const SpringConstants<V> constants{};
    const auto source = [&](int row) __attribute__((always_inline)) -> const Real* {
        return source_is_state(stage) ? e.rows[row].state : e.rows[row].work;
    };
    // A loaded value does not deserve a register until its next use. The compiler would keep it, and store
    // sums instead.
    const auto points = [](const Real* p) __attribute__((always_inline)) -> Points<V> {
        asm volatile("" : "+r"(p));
        if constexpr (damped) return {load3<V>(p, W), load3<V>(p + 3 * W, W)};
        else return {load3<V>(p, W), {}};
    };
    const auto begin_spring = [&](const Points<V>& a, const Real* b) __attribute__((always_inline)) {
        asm volatile("" : "+r"(b));
        return stretch<damped>(a, b, constants);
    };
    const Reach<V, 2> reach(e.reach);
    // Of the springs that start in one of the two vectors.
    const auto end_spring =
        [&]<int vector, SpringKind kind>(const Spring<V>& spring) __attribute__((always_inline)) {
            const Real* coefficients = e.coefficients + kind * (EdgeCoefficientIndex::count * W);
            asm volatile("" : "+r"(coefficients));
            if constexpr (kind == to_below) return force<damped, Springs::all>(spring, coefficients);
            else return force<damped, Springs::some>(spring, coefficients, reach(vector, 1));
        };

    edge_finish<Arch, Real>(e);
    // Received by the row from the one before: its two vectors, and past its end.
    Vector3<V> received[2] = {load3<V>(e.received[0], W), load3<V>(e.received[0] + 3 * W, W)};
    Vector3<V> received_past = load3<V>(e.received[0] + 6 * W, W);
    // The forces on the second vector are known so late that its stage is finished in the next row.
    Real* const second = e.force + 3 * W;
    const auto finish_second = [&](int row) __attribute__((always_inline)) {
        finish_stage<V, Real, stage, 2>(e, row_to_finish(e, row, source(row)), 1, load3<V>(second, W));
    };
    for (int row = begin; row < end; ++row) {
        const Real* const here = source(row);
        const Real* const below = source(row + 1);
        const Points<V> past = points(here + 1);
        Spring<V> rising_1 = begin_spring(past, below + stride);
        Spring<V> side_1 = begin_spring(past, here + stride);  // seen from its other end
        root(rising_1, constants);
        const Points<V> first = points(here);
        Spring<V> side_0 = begin_spring(first, here + stride);
        root(side_1, constants);
        const auto rises_1 = end_spring.template operator()<1, to_diagonal>(rising_1);
        const auto handed_past = received_past - rises_1;
        Spring<V> falling_0 = begin_spring(first, below + stride);
        root(side_0, constants);
        const auto pulls_1 = end_spring.template operator()<1, to_right>(side_1);
        const auto past_last = shifted_lanes(handed_past - pulls_1);
        if (row > begin) finish_second(row - 1);
        Spring<V> down_0 = begin_spring(first, below);
        root(falling_0, constants);
        const auto pulls_0 = end_spring.template operator()<0, to_right>(side_0);
        const auto within_1 = pulls_0 + pulls_1;
        const Points<V> other = points(here + stride);
        Spring<V> rising_0 = begin_spring(other, below);
        root(down_0, constants);
        const auto falls_0 = end_spring.template operator()<0, to_diagonal>(falling_0);
        const auto diagonals_1 = falls_0 + rises_1;
        Spring<V> falling_1 = begin_spring(other, below + 1);
        root(rising_0, constants);
        const auto drops_0 = end_spring.template operator()<0, to_below>(down_0);
        const auto force_0 = ((received[0] - (drops_0 + falls_0)) - pulls_0) + past_last;
        finish_stage<V, Real, stage, 2>(e, row_to_finish(e, row, here), 0, force_0);
        Spring<V> down_1 = begin_spring(other, below + stride);
        root(falling_1, constants);
        const auto rises_0 = end_spring.template operator()<0, to_diagonal>(rising_0);
        const auto handed_0 = drops_0 + rises_0;
        root(down_1, constants);
        const auto falls_1 = end_spring.template operator()<1, to_diagonal>(falling_1);
        const auto drops_1 = end_spring.template operator()<1, to_below>(down_1);
        store3(second, W, within_1 + (received[1] - (drops_1 + (rises_0 + falls_1))));
        received[0] = handed_0;
        received[1] = drops_1 + diagonals_1;
        received_past = falls_1;
    }
    if (begin < end) finish_second(end - 1);
    store3(e.received[0], W, received[0]);
    store3(e.received[0] + 3 * W, W, received[1]);
    store3(e.received[0] + 6 * W, W, received_past);
    end_rows<V>(e, begin, end);
}

}  // namespace
}  // namespace clothsim
