// The kernels of one instruction set: tables of function pointers, filled in small files of its own.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "kernels/edge/edge_arguments.hpp"
#include "kernels/gather/gather_arguments.hpp"
#include "kernels/instruction_set.hpp"
#include "kernels/row_arguments.hpp"
#include "kernels/state_rows.hpp"
#include "model/thread_grid.hpp"

namespace clothsim {

struct ContactKernels;

template <class Real>
using GatherKernel = void (*)(const GatherArguments<Real>&, const Tile&);

// The edge kernel: one of the last two rows, the end of its stage, and many rows. The last computes the
// forces of the two rows before a band on it.
template <class Real>
using EdgeLastRowKernel = void (*)(EdgeArguments<Real>&, int row, const EdgeSources<Real>&);
template <class Real>
using EdgeFinishKernel = void (*)(EdgeArguments<Real>&);
template <class Real>
using EdgeRowsKernel = void (*)(EdgeArguments<Real>&, int begin, int end);
template <class Real>
using EdgeHaloKernel = void (*)(EdgeArguments<Real>&, const EdgeSources<Real>& before_2,
                                const EdgeSources<Real>& before);

// The length of a spring at rest as the edge kernel sees it, to the last bit.
template <class Real>
struct RestLength {
    Real squared;
    Real reciprocal;  // times root_scale
};

// The edge kernel's rows of a cloth.
template <class Real>
struct EdgeKernels {
    EdgeRowsKernel<Real> rows;
    EdgeLastRowKernel<Real> last_row;
    EdgeHaloKernel<Real> halo;
};

// The rows of cloths with structural and shear springs: a part each without and with bend springs and
// damping. Versions for other cloths would take 0.7 to 0.8 of their time, and a fifth of the whole
// compilation; no ready scene has such a cloth. Each part is an object file of its own, as one file would
// take gigabytes to compile.
inline constexpr int edge_part_count = 4;
template <InstructionSet set, class Real, int part>
struct EdgePartOf {
    static const EdgeRowsKernel<Real> rows;
};

template <class Real>
struct RealKernels : RowsKernels<Real> {
    StateRowKernels<Real> state_rows;
    GatherKernel<Real> gather;
    EdgeKernels<Real> edge_of_any;
    EdgeFinishKernel<Real> edge_finish;
    std::array<const EdgeRowsKernel<Real>*, edge_part_count> edge_parts;  // null: not compiled in versions
    Real root_scale;  // the edge kernel's 1/l comes multiplied by it
    RestLength<Real> (*rest_length)(Real along_columns, Real along_rows);
    int lanes;

    // `damped_alike`: all families, or none of them.
    EdgeKernels<Real> edge(const Features& features, bool damped_alike) const {
        const int part = features.family[bend] | features.spring_damping << 1;
        const bool in_versions = features.family[structural] && features.family[shear] && damped_alike;
        EdgeKernels<Real> kernels = edge_of_any;
        if (in_versions && edge_parts[std::size_t(part)]) kernels.rows = *edge_parts[std::size_t(part)];
        return kernels;
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

// The instruction sets that were built, best first, and those of them that this processor has.
const std::vector<const KernelTable*>& built_instruction_sets();
std::vector<const KernelTable*> supported_instruction_sets();

// `name` empty: the environment variable CLOTHSIM_ISA, else the best supported one. Throws
// std::invalid_argument for a name that is not built or not supported.
const KernelTable& choose_instruction_set(const std::string& name);

// The environment variable that chooses the kernels of the next engine.
std::string kernel_environment();

}  // namespace clothsim
