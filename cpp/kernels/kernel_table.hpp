// The kernels of one instruction set: tables of function pointers, filled in one small file each.
#pragma once

#include <array>
#include <string_view>

#include "benchmark/limit_kernels.hpp"
#include "kernels/edge_arguments.hpp"
#include "kernels/gather_arguments.hpp"

namespace clothsim {

// What a scene needs from the force loop. Everything absent is compiled out.
struct Features {
    bool structural, shear, bend, spring_damping;
    constexpr int index() const { return structural | shear << 1 | bend << 2 | spring_damping << 3; }
    static constexpr Features from_index(int i) {
        return {bool(i & 1), bool(i & 2), bool(i & 4), bool(i & 8)};
    }
    static constexpr int count = 16;
};

template <class Real>
using GatherKernel = void (*)(const GatherArguments<Real>&, const Tile&);

// Calls `hit(context, row, column)` for every point of the tile closer than the radius.
using HitCallback = void (*)(void* context, int row, int column);
template <class Real>
using SphereKernel = void (*)(const SphereTest<Real>&, const Tile&, HitCallback, void* context);

// The edge kernel: one of the last two rows, the end of its stage, many rows, and what the two rows before a band hand on
// to it.
template <class Real>
using EdgeLastRowKernel = void (*)(EdgeArguments<Real>&, int row, const EdgeSources<Real>&);
template <class Real>
using EdgeFinishKernel = void (*)(EdgeArguments<Real>&);
template <class Real>
using EdgeRowsKernel = void (*)(EdgeArguments<Real>&, int begin, int end);
template <class Real>
using EdgeHaloKernel = void (*)(EdgeArguments<Real>&, const EdgeSources<Real>& before_2,
                                const EdgeSources<Real>& before);

// The length of a spring at rest as the fused kernels see it, to the last bit.
template <class Real>
struct RestLength {
    Real squared;
    Real reciprocal;  // times root_scale
};

template <class Real>
struct RealKernels {
    std::array<GatherKernel<Real>, Features::count> gather;         // fused multiply-add where there is one
    std::array<GatherKernel<Real>, Features::count> gather_strict;  // same bits on every instruction set
    SphereKernel<Real> sphere;
    std::array<EdgeLastRowKernel<Real>, Features::count> edge_last_row;
    std::array<EdgeRowsKernel<Real>, Features::count> edge_rows;
    std::array<EdgeHaloKernel<Real>, Features::count> edge_halo;
    EdgeFinishKernel<Real> edge_finish;
    Real root_scale;  // the edge kernel's 1/l comes multiplied by it
    RestLength<Real> (*rest_length)(Real along_columns, Real along_rows);
    int lanes;
    LimitKernels<Real> limits;
};

struct KernelTable {
    std::string_view name;   // "sse2", "avx2", "avx512"
    std::string_view flags;  // compiler flags of its file
    bool (*supported)();
    const RealKernels<float>& single;
    const RealKernels<double>& double_;  // in a file of its own, to be compiled side by side
};

template <class Real>
const RealKernels<Real>& kernels_of(const KernelTable& table) {
    if constexpr (sizeof(Real) == 4) return table.single;
    else return table.double_;
}

}  // namespace clothsim
