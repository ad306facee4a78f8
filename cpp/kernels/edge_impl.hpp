// The edge kernel: every spring once, for speed.
//
// Layout ("row-lifted"). With m vectors of W lanes a row, vector k, lane l holds column l m + k:
//
//     lane          0      1      2             the right-hand neighbour of a whole vector is the next
//     vector 0    0      m     2m     ...       vector, an aligned load without a shuffle; only behind
//     vector 1    1     m+1   2m+1    ...       the last vector stands vector 0 again, one lane further.
//     ...
//
// A row is stored vector by vector, all components of vector 0, then all of vector 1: one stream of memory.
//
// A sweep goes from row to row. A row adds the force of each of its springs to its own points and hands the
// opposite force on: within the row in registers, to the next row in `received`, to the row after it in
// `received_2`; what passes the row's end belongs to its first vectors, a lane further, and reaches them last.
// A row's forces are complete at its end; its Runge-Kutta stage is finished vector by vector while the next row's
// springs are summed, between operations that wait for each other. Nothing needs the row's old stage state any
// more: the new one replaces it.
//
// Sweeps may start anywhere and go up or down: the force on a point is summed as
//
//     within the row + ((vertical + 2nd vertical) + (diagonal + other diagonal) of the rows before
//                      -  the same of the rows behind)
//
// (what passes the row's end likewise, in a sum of its own)
// which gives the same bits either way, and `edge_halo` repeats what the two rows before a band hand on. So
// do any number of threads.
#pragma once

#include "kernels/edge_arguments.hpp"
#include "kernels/kernel_table.hpp"
#include "kernels/vector3.hpp"

namespace clothsim {
namespace {

template <class V>
CLOTHSIM_INLINE Vector3<V> shifted_lanes(const Vector3<V>& a) {
    return {next_lane(a.x), next_lane(a.y), next_lane(a.z)};
}

#define CLOTHSIM_EACH(i) [&](auto i) __attribute__((always_inline))

// What every spring needs. Constants that the compiler knows it would load for each spring.
template <class V>
struct SpringConstants {
    V smallest = in_register(V(smallest_squared_length<typename V::value_type>));
    V newton = in_register(V(newton_constant<typename V::value_type>));
};

template <class V>
struct Points {
    Vector3<V> x, v;
};

// A vector of springs on its way to a force. One takes some sixty cycles from its first operation to the last, and each
// of them waits for the one before; so a row is written with three springs under way, one in each of the steps
// `stretch`, `root` and `force`.
template <class V>
struct Spring {
    Vector3<V> d;  // difference of positions
    V rate;        // its product with the difference of velocities
    V root;        // squared length, then root_scale / length
};

// From points in registers to points in memory at `b`.
template <bool damped, class V, class Real>
CLOTHSIM_INLINE Spring<V> stretch(const Points<V>& a, const Real* b, const SpringConstants<V>& constants) {
    constexpr int W = int(V::size);
    Spring<V> s;
    s.d = a.x - load3<V>(b, W);
    s.root = xsimd::fma(s.d.x, s.d.x, constants.smallest);
    s.root = xsimd::fma(s.d.y, s.d.y, s.root);
    s.root = xsimd::fma(s.d.z, s.d.z, s.root);
    if constexpr (damped) {
        const Vector3<V> w = a.v - load3<V>(b + 3 * W, W);
        s.rate = w.x * s.d.x;
        s.rate = xsimd::fma(w.y, s.d.y, s.rate);
        s.rate = xsimd::fma(w.z, s.d.z, s.rate);
    }
    return s;
}

template <class V>
CLOTHSIM_INLINE void root(Spring<V>& s, const SpringConstants<V>& constants) {
    s.root = scaled_reciprocal_root(s.root, constants.newton);
}

// Force / mass on the points at b. `complete`: no lane lacks its spring and all families are damped alike, so that
// the damping constant is folded into the scale of the row.
template <bool damped, bool complete, class V, class Real>
CLOTHSIM_INLINE Vector3<V> force(const Spring<V>& s, const Real* coefficients) {
    constexpr int W = int(V::size);
    const V stiffness = V::load_aligned(coefficients + EdgeCoefficientIndex::stiffness * W);
    const V tension = V::load_aligned(coefficients + EdgeCoefficientIndex::tension * W);
    V scale;
    if constexpr (damped) {
        scale = s.rate;
        if constexpr (!complete) scale = scale * V::load_aligned(coefficients + EdgeCoefficientIndex::damping * W);
        scale = xsimd::fms(scale, s.root, tension);
        scale = exact_at_rest<Real> ? scale * s.root + stiffness : xsimd::fma(scale, s.root, stiffness);
    } else {
        scale = exact_at_rest<Real> ? stiffness - s.root * tension : xsimd::fnma(s.root, tension, stiffness);
    }
    return {scale * s.d.x, scale * s.d.y, scale * s.d.z};
}

// Of code that serves all stages and asks which one it is.
constexpr Stage any_stage = Stage(-1);

// Whether a stage looks at x_n and v_n, in state records, or at what the stage before left in work records.
constexpr bool source_is_state(Stage stage) { return stage == Stage::first || stage == Stage::evaluate; }

// Elements from vector to vector of the rows at which a stage looks.
template <class V>
CLOTHSIM_INLINE std::ptrdiff_t source_stride(Stage stage) {
    constexpr int state = sizeof(typename V::value_type) == 4 ? StateRecord::count_compensated : StateRecord::count;
    return (source_is_state(stage) ? state : WorkRecord::count) * int(V::size);
}

// The row before, whose forces are known: its stage is finished while the springs of the next row are summed.
template <class Real>
struct PendingRow {
    bool there = false;
    Real* state;
    Real* work;
    const Real* source;
    const Real* scale;
    const Real* free;
};

template <class Real>
CLOTHSIM_INLINE PendingRow<Real> pending_row(const EdgeArguments<Real>& e) {
    if (e.pending < 0) return {};
    const EdgeRowPointers<Real>& row = e.rows[e.pending];
    return {true, row.state, row.work, e.pending_source, row.scale, row.free};
}

// Finish the stage of one vector.
template <class V, class Real, Stage stage>
CLOTHSIM_INLINE void finish_stage(const EdgeArguments<Real>& e, const PendingRow<Real>& row, int k) {
    constexpr int W = int(V::size);
    constexpr bool compensated = sizeof(Real) == 4;
    constexpr int state_stride = (compensated ? StateRecord::count_compensated : StateRecord::count) * W;
    const Real* const force = e.force + k * 3 * W;
    const Real* const source = row.source + k * source_stride<V>(stage);
    Real* const state = row.state + k * state_stride;
    Real* const work = row.work + k * (WorkRecord::count * W);
    const V scale = V::load_aligned(row.scale + k * e.scale_stride);
    const V step(stage == Stage::third ? e.h : e.half_h), h2_6(e.h2_6), h_6(e.h_6);
    V acceleration[3];
    each<3>(CLOTHSIM_EACH(j) { acceleration[j] = V::load_aligned(force + j * W); });
    if (__builtin_expect(e.point_damping != 0, 0))
        each<3>(CLOTHSIM_EACH(j) {
            acceleration[j] = xsimd::fnma(V(e.point_damping), V::load_aligned(source + (3 + j) * W), acceleration[j]);
        });
    each<3>(CLOTHSIM_EACH(j) { acceleration[j] = xsimd::fma(acceleration[j], scale, V(e.gravity[j])); });
    if (__builtin_expect(row.free != nullptr, 0)) {
        const V zero(Real(0));
        const auto free = V::load_aligned(row.free + k * W) != zero;
        each<3>(CLOTHSIM_EACH(j) { acceleration[j] = xsimd::select(free, acceleration[j], zero); });
    }
    each<3>(CLOTHSIM_EACH(j) {
        Real* const first = work + (WorkRecord::first + j) * W;
        Real* const sum = work + (WorkRecord::sum + j) * W;
        Real* const x = state + j * W;
        Real* const v = state + (3 + j) * W;
        const V a = acceleration[j];
        if constexpr (stage == Stage::evaluate) {
            a.store_aligned(first);
        } else if constexpr (stage == Stage::fourth) {
            add_increment<compensated>(v, v + StateRecord::compensation * W, h_6 * (V::load_aligned(sum) + a));
        } else {
            const V v0 = V::load_aligned(v), vs = stage == Stage::first ? v0 : V::load_aligned(source + (3 + j) * W);
            xsimd::fma(step, vs, V::load_aligned(x)).store_aligned(work + j * W);
            xsimd::fma(step, a, v0).store_aligned(work + (3 + j) * W);
            if constexpr (stage == Stage::first) a.store_aligned(first);
            if constexpr (stage == Stage::second) a.store_aligned(sum);
            if constexpr (stage == Stage::third) {
                const V middle = V::load_aligned(sum) + a, three = V::load_aligned(first) + middle;
                (three + middle).store_aligned(sum);
                add_increment<compensated>(x, x + StateRecord::compensation * W, xsimd::fma(step, v0, h2_6 * three));
            }
        }
    });
}

template <class V, class Real, Stage stage>
CLOTHSIM_INLINE void finish(const EdgeArguments<Real>& e, const PendingRow<Real>& row, int k) {
    if constexpr (stage != any_stage) return finish_stage<V, Real, stage>(e, row, k);
    switch (e.stage) {
        case Stage::first: return finish_stage<V, Real, Stage::first>(e, row, k);
        case Stage::second: return finish_stage<V, Real, Stage::second>(e, row, k);
        case Stage::third: return finish_stage<V, Real, Stage::third>(e, row, k);
        case Stage::fourth: return finish_stage<V, Real, Stage::fourth>(e, row, k);
        case Stage::evaluate: return finish_stage<V, Real, Stage::evaluate>(e, row, k);
    }
}

// Ask for the share of a row ahead that belongs to a vector. In one go the requests would wait for each other, and the
// arithmetic with them.
template <class V, class Real>
CLOTHSIM_INLINE void fetch(const EdgeArguments<Real>& e, const Real* ahead, int k) {
    constexpr int W = int(V::size), line = 64 / int(sizeof(Real));
    constexpr int state_stride = (sizeof(Real) == 4 ? StateRecord::count_compensated : StateRecord::count) * W;
    const Real* const record = ahead + k * state_stride;
    for (int i = e.ahead_begin; i < e.ahead_end; i += line) __builtin_prefetch(record + i, 0, 2);  // to the second-level cache
}

// Where a vector stands among those of its row: how many of its springs along the row lead past the last vector.
enum class Place { inner, second_last, last, any };

// All springs that start in a row (own), or only what they hand down to rows below (a halo row above a band). `fixed` is
// the number of vectors of a row, 0 if it is not known here. `ahead`: a row of which a share is fetched meanwhile.
template <class Arch, class Real, int index, Stage stage, int fixed, bool own, bool has_below, bool has_below_2>
CLOTHSIM_INLINE void edge_row(const EdgeArguments<Real>& e, const EdgeSources<Real>& source, const Real* __restrict received,
                              Real* __restrict hand_down, const PendingRow<Real>& pending, const Real* ahead = nullptr) {
    using V = Lanes<Real, Arch>;
    constexpr int W = int(V::size);
    constexpr Features features = Features::from_index(index);
    constexpr bool damped = features.spring_damping;
    constexpr bool vertical = features.structural && has_below;
    constexpr bool shear = features.shear && has_below;
    constexpr bool bend_down = features.bend && has_below_2;
    constexpr bool along = features.structural && own;
    constexpr bool along_2 = features.bend && own;
    const std::ptrdiff_t stride = source_stride<V>(stage == any_stage ? e.stage : stage);
    const int m = fixed ? fixed : e.vectors;
    const Real* const here = source.here;
    const Real* const below = source.below;
    const Real* const below_2 = source.below_2;
    Real* const __restrict received_2 = e.received_2;
    Real* const __restrict forces = e.force;
    const Real* const __restrict all_springs = e.coefficients;
    const auto points = [&](const Real* p) __attribute__((always_inline)) -> Points<V> {
        if constexpr (damped) return {load3<V>(p, W), load3<V>(p + 3 * W, W)};
        else return {load3<V>(p, W), {}};
    };
    // Behind the last vector stands the first, a lane on.
    const auto place_of = [&](int k) __attribute__((always_inline)) { return k < m ? k * stride : (k - m) * stride + 1; };

    const Vector3<V> none{V(Real(0)), V(Real(0)), V(Real(0))};
    Vector3<V> to_next = none, to_next_2 = none;  // handed on within the row
    Vector3<V> falling = none, rising = none;     // the half of a diagonal pair that the vector before has
    Vector3<V> kept[2];                           // forces to which the row's end adds, where `fixed` keeps them in registers
    const SpringConstants<V> constants{};

    // `cut`: coefficients of springs that some lanes lack. `first`: the row's first vector, which is handed nothing.
    const auto column = [&]<Place place, bool first>(int k, const Real* cut) __attribute__((always_inline)) {
        const std::ptrdiff_t at = k * stride;
        const std::ptrdiff_t next = place == Place::any ? place_of(k + 1) : place == Place::last ? 1 : at + stride;
        const std::ptrdiff_t next_2 = place == Place::any           ? place_of(k + 2)
                                      : place == Place::last        ? stride + 1
                                      : place == Place::second_last ? 1
                                                                    : at + 2 * stride;
        constexpr bool whole = place != Place::any;
        constexpr bool whole_next = place == Place::inner || place == Place::second_last;
        constexpr bool whole_next_2 = place == Place::inner;
        const auto coefficients = [&](EdgeKind kind, bool complete) __attribute__((always_inline)) {
            return (complete ? all_springs : cut) + kind * (EdgeCoefficientIndex::count * W);
        };
        const std::ptrdiff_t vector = std::ptrdiff_t(k) * 3 * W;

        if constexpr (!fixed && own)
            if (ahead) fetch<V>(e, ahead, k);
        Vector3<V> handed = falling, pair = rising, behind = none;
        Spring<V> to_up, to_down, to_far, to_down_2, to_side, to_side_2;
        if constexpr (shear) to_up = stretch<damped>(points(here + next), below + at, constants);
        const Points<V> point = points(here + at);
        if constexpr (vertical) to_down = stretch<damped>(point, below + at, constants);
        if constexpr (shear) root(to_up, constants);
        if constexpr (shear) to_far = stretch<damped>(point, below + next, constants);
        if constexpr (vertical) root(to_down, constants);
        if constexpr (shear) {
            rising = force<damped, whole_next>(to_up, coefficients(to_diagonal, whole_next));
            handed = first ? rising : falling + rising;
        }
        if constexpr (bend_down) to_down_2 = stretch<damped>(point, below_2 + at, constants);
        if constexpr (shear) root(to_far, constants);
        if constexpr (vertical) {
            behind = force<damped, whole>(to_down, coefficients(to_below, whole));
            const Vector3<V> straight = features.bend ? behind + load3<V>(received_2 + vector, W) : behind;
            handed = shear ? straight + handed : straight;
        } else if constexpr (has_below && features.bend) {
            const Vector3<V> straight = load3<V>(received_2 + vector, W);
            handed = shear ? straight + handed : straight;
        }
        if constexpr (has_below) store3(hand_down + vector, W, handed);
        if constexpr (along) to_side = stretch<damped>(point, here + next, constants);
        if constexpr (bend_down) root(to_down_2, constants);
        if constexpr (shear) {
            falling = force<damped, whole_next>(to_far, coefficients(to_diagonal, whole_next));
            pair = first ? falling : pair + falling;
        }
        if constexpr (along_2) to_side_2 = stretch<damped>(point, here + next_2, constants);
        if constexpr (along) root(to_side, constants);
        if constexpr (bend_down) {
            const Vector3<V> down_2 = force<damped, whole>(to_down_2, coefficients(to_below_2, whole));
            store3(received_2 + vector, W, down_2);
            behind = vertical ? behind + down_2 : down_2;
        }
        if constexpr (own) {
            if constexpr (shear) behind = vertical || bend_down ? behind + pair : pair;
            Vector3<V> before = load3<V>(received + vector, W);
            if constexpr (vertical || shear || bend_down) before = before - behind;
            if (__builtin_expect(pending.there, 1)) finish<V, Real, stage>(e, pending, k);
            if constexpr (along_2) root(to_side_2, constants);
            Vector3<V> within = to_next, sum;  // what the row gives to the vector: of the first, what it takes
            to_next = to_next_2;
            if constexpr (along) {
                const Vector3<V> side = force<damped, whole_next>(to_side, coefficients(to_right, whole_next));
                within = first ? side : within - side;
                to_next = along_2 && !first ? to_next + side : side;
            }
            if constexpr (along_2) {
                to_next_2 = force<damped, whole_next_2>(to_side_2, coefficients(to_right_2, whole_next_2));
                within = !first ? within - to_next_2 : along ? within + to_next_2 : to_next_2;
            }
            if constexpr (first) sum = along || along_2 ? before - within : before;
            else sum = within + before;
            if (fixed && k < 2) kept[k] = sum;
            else store3(forces + vector, W, sum);
        }
    };
    constexpr int class_size = edge_kind_count * EdgeCoefficientIndex::count * W;
    if constexpr (fixed > 0) {
        each<fixed - 2>(CLOTHSIM_EACH(k) { column.template operator()<Place::inner, k == 0>(k, nullptr); });
        // The first class has all springs; so the last two vectors have the second and the third.
        column.template operator()<Place::second_last, fixed == 2>(fixed - 2, all_springs + class_size);
        column.template operator()<Place::last, false>(fixed - 1, all_springs + 2 * class_size);
    } else if (e.complete) {
        for (int k = 0; k < m - 2; ++k) column.template operator()<Place::inner, false>(k, nullptr);
        column.template operator()<Place::second_last, false>(m - 2, all_springs + class_size);
        column.template operator()<Place::last, false>(m - 1, all_springs + 2 * class_size);
    } else {
        for (int k = 0; k < m; ++k)
            column.template operator()<Place::any, false>(k, all_springs + e.coefficient_class[k] * class_size);
    }

    const std::ptrdiff_t past = std::ptrdiff_t(m) * 3 * W;
    if constexpr (shear) store3(hand_down + past, W, falling);
    if constexpr (own) {
        Vector3<V> past_last = to_next;
        if constexpr (features.shear) {
            const Vector3<V> before = load3<V>(received + past, W);
            past_last = (shear ? before - rising : before) + past_last;
        }
        // What is handed on past the last vector belongs to the first ones, a lane further.
        const auto sum = [&](int k) { return fixed ? kept[k] : load3<V>(forces + k * 3 * W, W); };
        store3(forces, W, sum(0) + shifted_lanes(past_last));
        if constexpr (along_2) store3(forces + 3 * W, W, sum(1) + shifted_lanes(to_next_2));
        else if constexpr (fixed > 0) store3(forces + 3 * W, W, kept[1]);
    }
}

// Whether all points of a row are beyond the sphere's plane; padding is above every plane.
template <class V, class Real>
CLOTHSIM_INLINE bool beyond_plane(const EdgeArguments<Real>& e, const Real* row, std::ptrdiff_t stride, const SphereOutline<Real>& sphere) {
    if (sphere.axis < 0) return false;
    const Real* const x = row + sphere.axis * int(V::size);
    V nearest = V::load_unaligned(x);
    if (sphere.above) {
        for (int k = 1; k < e.vectors; ++k) nearest = xsimd::min(nearest, V::load_unaligned(x + k * stride));
        return xsimd::all(nearest >= V(sphere.plane));
    }
    for (int k = 1; k < e.vectors; ++k) nearest = xsimd::max(nearest, V::load_unaligned(x + k * stride));
    return xsimd::all(nearest <= V(sphere.plane));
}

template <class V, class Real>
CLOTHSIM_INLINE void edge_spheres(const EdgeArguments<Real>& e, int row) {
    constexpr int W = int(V::size);
    constexpr int state_stride = (sizeof(Real) == 4 ? StateRecord::count_compensated : StateRecord::count) * W;
    for (int s = 0; s < e.sphere_count; ++s) {
        SphereOutline<Real>& sphere = e.spheres[s];
        if (beyond_plane<V>(e, e.rows[row].state, state_stride, sphere)) continue;
        sphere.crossed = true;
        const Vector3<V> center{V(sphere.center[0]), V(sphere.center[1]), V(sphere.center[2])};
        for (int k = 0; k < e.vectors; ++k) {
            const Vector3<V> m = load3<V>(e.rows[row].state + k * state_stride, W) - center;
            const auto inside = m.x * m.x + m.y * m.y + m.z * m.z < V(sphere.radius_squared);
            if (__builtin_expect(xsimd::any(inside), 0)) e.hit(e.context, s, row, k, inside.mask());
        }
    }
}

// What is left to do when the vectors of the pending row are finished.
template <class V, class Real>
CLOTHSIM_INLINE void end_pending(EdgeArguments<Real>& e) {
    if (e.stage == Stage::fourth && e.sphere_count > 0 && e.pending >= 0) edge_spheres<V>(e, e.pending);
}

// The forces on one row, and the end of the stage of the row before.
template <class Arch, class Real, int index>
void edge_stage(EdgeArguments<Real>& e, int row, const EdgeSources<Real>& source) {
    const auto run = [&]<bool has_below, bool has_below_2>() {
        edge_row<Arch, Real, index, any_stage, 0, true, has_below, has_below_2>(e, source, e.received[0], e.received[1],
                                                                                  pending_row(e));
    };
    if (source.below_2) run.template operator()<true, true>();
    else if (source.below) run.template operator()<true, false>();
    else run.template operator()<false, false>();
    std::swap(e.received[0], e.received[1]);
    end_pending<Lanes<Real, Arch>>(e);
    e.pending = row;
    e.pending_source = source.here;
}

// The end of the stage of the row that is pending.
template <class Arch, class Real>
void edge_finish(EdgeArguments<Real>& e) {
    using V = Lanes<Real, Arch>;
    const PendingRow<Real> pending = pending_row(e);
    for (int k = 0; pending.there && k < e.vectors; ++k) finish<V, Real, any_stage>(e, pending, k);
    end_pending<V>(e);
    e.pending = -1;
}

// Rows [begin, end) in one stage, with one number of vectors; any_stage and 0: those of `e`.
template <class Arch, class Real, int index, Stage stage, int fixed>
__attribute__((noinline)) void edge_rows_of(EdgeArguments<Real>& e, int begin, int end) {
    const bool of_state = source_is_state(stage == any_stage ? e.stage : stage);
    const auto source = [&](int row) -> const Real* { return of_state ? e.rows[row].state : e.rows[row].work; };
    const auto ahead = [&](int row) { return e.ahead > 0 && row + e.ahead < e.row_count ? e.rows[row + e.ahead].state : nullptr; };
    Real* received = e.received[0];
    Real* hand_down = e.received[1];
    for (int row = begin; row < end; ++row) {
        const EdgeSources<Real> sources{source(row), source(row + 1), source(row + 2)};
        edge_row<Arch, Real, index, stage, fixed, true, true, true>(e, sources, received, hand_down, pending_row(e), ahead(row));
        std::swap(received, hand_down);
        end_pending<Lanes<Real, Arch>>(e);
        e.pending = row;
        e.pending_source = sources.here;
    }
    e.received[0] = received;
    e.received[1] = hand_down;
}

// Rows of 32 points in the paper's cloth are short enough to be written out vector by vector.
template <class Arch, class Real>
constexpr int written_out = 32 / int(Lanes<Real, Arch>::size) <= 4 ? 32 / int(Lanes<Real, Arch>::size) : 0;

template <class Arch, class Real>
bool is_written_out(const EdgeArguments<Real>& e) {
    return written_out<Arch, Real> > 0 && e.complete && e.vectors == written_out<Arch, Real>;
}

// One stage of rows [begin, end), of which all have two more behind them in `e.rows`.
template <class Arch, class Real, int index>
void edge_rows(EdgeArguments<Real>& e, int begin, int end) {
    constexpr int fixed = written_out<Arch, Real>;
    if (is_written_out<Arch>(e) && e.ahead == 0)
        switch (e.stage) {
            case Stage::first: return edge_rows_of<Arch, Real, index, Stage::first, fixed>(e, begin, end);
            case Stage::second: return edge_rows_of<Arch, Real, index, Stage::second, fixed>(e, begin, end);
            case Stage::third: return edge_rows_of<Arch, Real, index, Stage::third, fixed>(e, begin, end);
            case Stage::fourth: return edge_rows_of<Arch, Real, index, Stage::fourth, fixed>(e, begin, end);
            case Stage::evaluate: return edge_rows_of<Arch, Real, index, Stage::evaluate, fixed>(e, begin, end);
        }
    edge_rows_of<Arch, Real, index, any_stage, 0>(e, begin, end);
}

// What the two rows before a band hand on to its first two.
template <class Arch, class Real, int index>
void edge_halo(EdgeArguments<Real>& e, const EdgeSources<Real>& before_2, const EdgeSources<Real>& before) {
    using V = Lanes<Real, Arch>;
    constexpr Features features = Features::from_index(index);
    constexpr int W = int(V::size);
    if constexpr (features.bend) {
        constexpr bool damped = features.spring_damping;
        const std::ptrdiff_t stride = source_stride<V>(e.stage);
        const SpringConstants<V> constants{};
        for (int k = 0; k < e.vectors; ++k) {
            const Real* const p = before_2.here + k * stride;
            Points<V> points{load3<V>(p, W), {}};
            if constexpr (damped) points.v = load3<V>(p + 3 * W, W);
            Spring<V> spring = stretch<damped>(points, before_2.below_2 + k * stride, constants);
            root(spring, constants);
            const auto hand = [&]<bool complete>(int which) {
                const Real* const c = e.coefficients + (which * edge_kind_count + to_below_2) * (EdgeCoefficientIndex::count * W);
                store3(e.received_2 + k * 3 * W, W, force<damped, complete>(spring, c));
            };
            if (e.complete) hand.template operator()<true>(0);
            else hand.template operator()<false>(e.coefficient_class[k]);
        }
    }
    const auto run = [&]<int fixed>() {
        edge_row<Arch, Real, index, any_stage, fixed, false, true, true>(e, before, e.received[0], e.received[1], {});
    };
    if (is_written_out<Arch>(e)) run.template operator()<written_out<Arch, Real>>();
    else run.template operator()<0>();
    std::swap(e.received[0], e.received[1]);
}

}  // namespace
}  // namespace clothsim
