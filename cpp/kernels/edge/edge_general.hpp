// The edge kernel for every cloth and every row: a loop over the springs of a row and over the
// lanes that have them. It sums as edge_row.hpp does, so that the bits are the same; missing
// springs are 0.
#pragma once

#include <utility>

#include "kernels/edge/edge_stage.hpp"

namespace clothsim {
namespace {

// Sums the springs that start in a row: its own, or only what they hand down to rows below.
template <class Real>
CLOTHSIM_INLINE Legs legs_of_row(const Features& features, const EdgeSources<Real>& source,
                                 bool own) {
    const bool there[3] = {own, source.below != nullptr, source.below_2 != nullptr};
    Legs legs = 0;
    for (int leg = 0; leg < leg_count; ++leg) {
        const Neighbour& kind = spring_kinds[kind_of_leg[leg]];
        legs |= Legs(features.has(kind) && there[kind.row]) << leg;
    }
    return legs;
}

template <class V, class Real, bool damped>
__attribute__((noinline)) void sum_row(const EdgeArguments<Real>& e,
                                       const EdgeSources<Real>& source, bool own,
                                       const PendingRow<Real>& pending, const Real* ahead) {
    constexpr int W = int(V::size), kind_size = EdgeCoefficientIndex::count * W,
                  class_size = spring_kind_count * kind_size;
    const Legs legs = legs_of_row(e.features, source, own);
    const auto has = [legs](Leg leg)
                         __attribute__((always_inline)) { return (legs >> leg & 1) != 0; };
    const std::ptrdiff_t stride = source_stride<V>(e.stage);
    const std::ptrdiff_t past = std::ptrdiff_t(e.vectors) * 3 * W;
    const int m = e.vectors;
    const auto points = [](const Real* p) __attribute__((always_inline)) -> PointLanes<V> {
        if constexpr (damped) return {load3<V>(p, W), load3<V>(p + 3 * W, W)};
        else return {load3<V>(p, W), {}};
    };
    // Behind the last vector stands the first, a lane on.
    const auto place_of = [&](int k) __attribute__((always_inline)) {
        return k < m ? k * stride : (k - m) * stride + 1;
    };
    const Vector3<V> none{V(Real(0)), V(Real(0)), V(Real(0))};
    Vector3<V> to_next = none, to_next_2 = none;  // passed on within the row
    Vector3<V> fell = none, rose = none;  // the diagonal forces of the vector before
    const SpringConstants<V> constants{};
    for (int k = 0; k < m; ++k) {
        const std::ptrdiff_t at = k * stride;
        const std::ptrdiff_t next = place_of(k + 1);
        const std::ptrdiff_t vector = std::ptrdiff_t(k) * 3 * W;
        const Real* const coefficients = e.coefficients + e.coefficient_class[k] * class_size;
        if (ahead) fetch<V>(e, ahead, k);
        const auto pull = [&](Leg leg, const PointLanes<V>& from, const Real* to)
                              __attribute__((always_inline)) {
                                  Spring<V> spring = stretch<damped>(from, to, constants);
                                  root(spring, constants);
                                  return force<damped, SpringChoice::by_coefficient>(
                                      spring, coefficients + kind_of_leg[leg] * kind_size);
                              };
        const PointLanes<V> point = points(source.here + at);
        if (pending.exists) finish_any<V, Real>(e, pending, k);

        Vector3<V> drop = none;
        Vector3<V> drop_2 = none;
        Vector3<V> falls = none;
        Vector3<V> rises = none;
        if (has(down)) drop = pull(down, point, source.below + at);
        if (has(falling)) {
            falls = pull(falling, point, source.below + next);
            rises = pull(rising, points(source.here + next), source.below + at);
        }
        if (source.below) {
            const Vector3<V> straight =
                e.features.family[bend] ? drop + load3<V>(e.received_2 + vector, W) : drop;
            store3(e.received[1] + vector, W, straight + (fell + rises));
        }
        if (has(down_2)) {
            drop_2 = pull(down_2, point, source.below_2 + at);
            store3(e.received_2 + vector, W, drop_2);
        }
        const Vector3<V> behind = (drop + drop_2) + (rose + falls);
        fell = falls;
        rose = rises;
        if (!own) continue;
        Vector3<V> within = to_next;
        to_next = to_next_2;
        if (has(side)) {
            const Vector3<V> pulls = pull(side, point, source.here + next);
            within = within - pulls;
            to_next = to_next + pulls;
        }
        if (has(side_2)) {
            to_next_2 = pull(side_2, point, source.here + place_of(k + 2));
            within = within - to_next_2;
        }
        store3(e.force + vector, W, within + (load3<V>(e.received[0] + vector, W) - behind));
    }
    if (source.below) store3(e.received[1] + past, W, fell);
    if (!own) return;
    // Forces past the last vector belong to the first vectors, a lane further.
    const Vector3<V> past_last = (load3<V>(e.received[0] + past, W) - rose) + to_next;
    store3(e.force, W, load3<V>(e.force, W) + shifted_lanes(past_last));
    store3(e.force + 3 * W, W, load3<V>(e.force + 3 * W, W) + shifted_lanes(to_next_2));
}

template <class V, class Real>
CLOTHSIM_INLINE void sum_row(EdgeArguments<Real>& e, const EdgeSources<Real>& source, bool own,
                             const Real* ahead = nullptr) {
    const PendingRow<Real> pending = own ? pending_row(e) : PendingRow<Real>{};
    if (e.features.spring_damping) sum_row<V, Real, true>(e, source, own, pending, ahead);
    else sum_row<V, Real, false>(e, source, own, pending, ahead);
    std::swap(e.received[0], e.received[1]);
}

// Takes rows [begin, end), with two more behind them in `e.rows`, through one stage: rows past the
// last of the cloth are null.
template <class Arch, class Real>
void edge_rows_of_any(EdgeArguments<Real>& e, int begin, int end) {
    using V = Lanes<Real, Arch>;
    const bool of_state = source_is_state(e.stage);
    const auto source = [&](int row) -> const Real* {
        return of_state ? e.rows[row].state : e.rows[row].work;
    };
    for (int row = begin; row < end; ++row) {
        const EdgeSources<Real> sources{source(row), source(row + 1), source(row + 2)};
        sum_row<V>(e, sources, true, row_ahead(e, row));
        e.pending = row;
        e.pending_source = sources.here;
        if (e.forces) e.forces(e);
    }
}

// Adds forces of the two rows before a band on its first two. Of the first of them only springs two
// rows on count: it comes without the row below.
template <class Arch, class Real>
void edge_halo_of_any(EdgeArguments<Real>& e, const EdgeSources<Real>& before_2,
                      const EdgeSources<Real>& before) {
    using V = Lanes<Real, Arch>;
    sum_row<V>(e, before_2, false);
    sum_row<V>(e, before, false);
}

}  // namespace
}  // namespace clothsim
