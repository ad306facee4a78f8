// The kernels of one instruction set: tables of function pointers, filled in small files of its
// own.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "kernels/edge/edge_arguments.hpp"
#include "kernels/gather/gather_arguments.hpp"
#include "kernels/row_arguments.hpp"
#include "lanes/instruction_set.hpp"

namespace clothsim {

template <class Real>
using GatherKernel = void (*)(const GatherArguments<Real>&, const Tile&);

// The edge kernel: many rows, the end of the stage of the last of them, and the forces of the two
// rows before a band on it.
template <class Real>
using EdgeRowsKernel = void (*)(EdgeArguments<Real>&, int begin, int end);
template <class Real>
using EdgeFinishKernel = void (*)(EdgeArguments<Real>&);
template <class Real>
using EdgeHaloKernel = void (*)(EdgeArguments<Real>&, const EdgeSources<Real>& before_2,
                                const EdgeSources<Real>& before);

// The rows of cloths with structural and shear springs: a part each without and with bend springs
// and damping. Versions for other cloths would take 0.7 to 0.8 of their time, and a fifth of the
// whole compilation; no ready scene has such a cloth. Each part is an object file of its own, as
// one file would take gigabytes to compile.
inline constexpr int edge_part_count = 4;
template <InstructionSet set, class Real, int part>
struct EdgePartOf {
    static const EdgeRowsKernel<Real> rows;
};

template <class Real>
struct RealKernels : RowsKernels<Real> {
    GatherKernel<Real> gather;
    EdgeRowsKernel<Real> edge_of_any;
    EdgeHaloKernel<Real> edge_halo;
    EdgeFinishKernel<Real> edge_finish;
    EdgeForcesKernel<Real> edge_forces;
    EdgeNearKernel<Real> edge_near;
    // A part that is not compiled in versions is null.
    std::array<const EdgeRowsKernel<Real>*, edge_part_count> edge_parts;
    Real root_scale;  // the edge kernel's 1/l comes multiplied by it
    // So is this, of a spring at rest as the edge kernel sees it, to the last bit.
    Real (*reciprocal_at_rest)(Real along_columns, Real along_rows);
    int lanes;

    // Returns the kernel of rows with two more behind them. `damped_alike`: all families are damped
    // alike, or none of them is.
    EdgeRowsKernel<Real> edge(const Features& features, bool damped_alike) const {
        const auto* const part =
            edge_parts[std::size_t(features.family[bend] | features.spring_damping << 1)];
        const bool in_versions =
            features.family[structural] && features.family[shear] && damped_alike;
        return in_versions && part ? *part : edge_of_any;
    }
};

struct KernelTable {
    InstructionSet set;
    std::string_view name;  // "sse2", "avx2", "avx512"
    std::string_view flags;  // compiler flags of its files
    RealKernels<float> single;
    RealKernels<double> double_;
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

// The first returns the instruction sets that were built, best first; the second those of them that
// this processor has.
const std::vector<const KernelTable*>& built_instruction_sets();
std::vector<const KernelTable*> supported_instruction_sets();

// Returns the instruction set of the environment variable CLOTHSIM_ISA, else the best supported
// one. Throws std::invalid_argument for a name that is not built or not supported.
const KernelTable& choose_instruction_set();

// Returns the value of that variable.
std::string kernel_environment();

}  // namespace clothsim
