// The edge engine as a field for the integrators of cpp/integrators. The kernel's `evaluate` stage gives
// accelerations at any state in its layout, row by row of a band.
//
// That stage writes an acceleration where a work record holds the first one. So the records of four stages
// share the place of one work record, a quarter each, and nothing lies unused between them.
#include "engines/edge_engine.hpp"
#include "memory/caches.hpp"

namespace clothsim {
namespace {

constexpr int accelerations_per_record = WorkRecord::count / 3;

}  // namespace

template <class Real>
FieldLayout EdgeEngine<Real>::field() const {
    const std::ptrdiff_t lanes = layout_.lanes, record = WorkRecord::count * lanes;
    FieldLayout f{};
    f.runs = layout_.vectors;
    f.length = 3 * layout_.lanes;
    f.row = layout_.row_size();
    f.run = layout_.stride;
    f.velocity = 3 * lanes;
    f.compensation = Base::compensated ? layout_.compensation() : 0;
    f.acceleration_origin = WorkRecord::first * lanes;  // the record's start lies that much before
    f.acceleration_row = layout_.vectors * record;
    f.acceleration_run = record;
    f.slots = accelerations_per_record;
    f.slot = 3 * lanes;
    f.block = (rows() * layout_.vectors + 1) * record;
    return f;
}

template <class Real>
void EdgeEngine<Real>::begin_sweep(const Real* state, Real* acceleration, FieldBand<Real>& band) {
    band.values.resize(std::size_t(scratch_size()));
    // The band and the two rows after it, which its last rows read. The stage only reads their state.
    const auto there = [&](int i) { return band.row(i) >= 0 && band.row(i) < rows(); };
    const std::ptrdiff_t acceleration_row = layout_.vectors * WorkRecord::count * layout_.lanes;
    band.pointers.clear();
    for (int i = 0; i < band.size() + 2 && there(i); ++i) {
        const int r = band.row(i);
        band.pointers.push_back(
            row_pointers(const_cast<Real*>(state), acceleration + r * acceleration_row, r));
    }
    EdgeArguments<Real>& e = band.edge = arguments(Stage::evaluate, 0, band.values.data());
    e.rows = band.pointers.data();
    if (band.size() * layout_.row_size() * std::ptrdiff_t(sizeof(Real)) > bytes_kept_in_cache()) {
        e.ahead = rows_before_use;
        e.ahead_end = layout_.stride;
        e.row_count = int(band.pointers.size());
    }

    const auto source = [&](int i) { return state + band.row(i) * layout_.row_size(); };
    if (!there(-1)) std::fill_n(e.received[0], 3 * handed_size(), Real(0));
    else edge_.halo(e, {source(-2), nullptr, source(0)}, {source(-1), source(0), source(1)});
}

template <class Real>
int EdgeEngine<Real>::sweep_rows(int begin, int end, FieldBand<Real>& band) {
    const int known = int(band.pointers.size()), inner = std::clamp(known - 2, begin, end);
    const auto source = [&](int at) -> const Real* {
        return at < known ? band.pointers[std::size_t(at)].state : nullptr;
    };
    edge_.rows(band.edge, begin, inner);
    for (int i = inner; i < end; ++i) edge_.last_row(band.edge, i, {source(i), source(i + 1), nullptr});
    if (end < band.size()) return end - 1;  // the kernel finishes a row with the next one
    kernels().edge_finish(band.edge);
    return end;
}

template FieldLayout EdgeEngine<float>::field() const;
template FieldLayout EdgeEngine<double>::field() const;
template void EdgeEngine<float>::begin_sweep(const float*, float*, FieldBand<float>&);
template void EdgeEngine<double>::begin_sweep(const double*, double*, FieldBand<double>&);
template int EdgeEngine<float>::sweep_rows(int, int, FieldBand<float>&);
template int EdgeEngine<double>::sweep_rows(int, int, FieldBand<double>&);

}  // namespace clothsim
