// The kernels of one instruction set: tables of function pointers, filled in small files of its own.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "benchmark/limit_kernels.hpp"
#include "kernels/component_rows.hpp"
#include "kernels/contact_kernels.hpp"
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

// The kernels of all sets of features in one compiler run would take minutes and gigabytes. Those of a share have bend
// springs and damping in common, or their absence.
inline constexpr int share_count = 4, features_in_share = Features::count / share_count;

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

// With one set of features.
template <class Real>
struct FeatureKernels {
    GatherKernel<Real> gather;         // fused multiply-add where there is one
    GatherKernel<Real> gather_strict;  // same bits on every instruction set
    EdgeLastRowKernel<Real> edge_last_row;
    EdgeRowsKernel<Real> edge_rows;
    EdgeHaloKernel<Real> edge_halo;
};

template <class Real>
using KernelShare = std::array<FeatureKernels<Real>, features_in_share>;

// Each in an object file of its own.
template <InstructionSet set, class Real, int share>
struct KernelShareOf {
    static const KernelShare<Real> kernels;
};

template <class Real>
struct RealKernels {
    std::array<const KernelShare<Real>*, share_count> shares;
    SphereKernel<Real> sphere;
    EdgeFinishKernel<Real> edge_finish;
    BeyondKernel<Real> beyond;
    ExtentKernel<Real> extent;
    Real root_scale;  // the edge kernel's 1/l comes multiplied by it
    RestLength<Real> (*rest_length)(Real along_columns, Real along_rows);
    int lanes;
    LimitKernels<Real> limits;

    const FeatureKernels<Real>& with(Features features) const {
        const int index = features.index();
        return (*shares[std::size_t(index / features_in_share)])[std::size_t(index % features_in_share)];
    }
};

struct KernelTable {
    InstructionSet set;
    std::string_view name;   // "sse2", "avx2", "avx512"
    std::string_view flags;  // compiler flags of its files
    RealKernels<float> single;
    RealKernels<double> double_;
    const ContactKernels& contact;
};

template <InstructionSet set>
struct KernelTableOf {
    static const KernelTable table;
};

template <class Real>
const RealKernels<Real>& kernels_of(const KernelTable& table) {
    if constexpr (sizeof(Real) == 4) return table.single;
    else return table.double_;
}

}  // namespace clothsim
