// How bands of rows work side by side without a barrier, and how large cloths stay in cache.
//
// Two bands that share a border sweep away from it, or both towards it (the bands of even number go up, the
// others down). At a border each needs the two rows of the other after the stage before, and hands over its own
// two as soon as they are done:
//
//     band 0   ^  far end: edge of the cloth
//              |  starts here
//     ------- border -------  each finishes its first two rows at the beginning of a stage: the other needs
//              |  starts here      them a stage later
//     band 1   v
//     ------- border -------  each finishes its last two rows at the end of a stage: the other needs them at
//     band 2   ^                  the end of the next
//
// The rows go through mailboxes with two slots, by the parity of the stage. Two are enough: a band can finish a
// stage only with its neighbour's rows of the stage before, so it is never two stages ahead.
//
// A cloth that fits in cache is swept stage by stage. In a larger one the four stages follow each other a few
// rows apart, so that a step reads and writes the state about once; what a stage leaves for the next one lives
// in a ring of rows. Where even such a ring of rows is more than the cache holds, rows are cut into strips (see
// LiftedLayout), and a step is done strip by strip. A strip's halo is good for one step. So a strip leaves the columns
// of its neighbours' halos in the seams as soon as a row is done, and takes its own halo from there as the next step
// comes to a row. Seams have two places, by the parity of the step, because strips come one after the other. How
// rows are cut depends on the cloth's shape and on the instruction set alone. Every thread does its band of each strip.
#include "simulation/edge_engine.hpp"

#include <omp.h>

#include "dynamics/methods.hpp"

namespace clothsim {
namespace {

constexpr int fewest_rows_per_band = 8;
// A neighbour answers within microseconds unless its processor is taken; then sleeping lets it have this one.
constexpr int spins_before_sleep = 500;

// Rows between two stages that follow each other: a row needs the two after it, and a row is finished by the next.
constexpr int rows_between_stages = 3;

// A band whose state and work fit into this many bytes is swept stage by stage.
constexpr std::ptrdiff_t bytes_kept_in_cache = 768 * 1024;

// Enough for the rows under way in a step to stay in cache; a single one unless that is less than half of them.
template <class Real>
int strips_of(const Plan& plan) {
    if (method_of(plan.integrator).scheme != Scheme::rk4) return 1;
    for (const Sphere& sphere : plan.spheres)
        if (sphere.response == Response::continuous) return 1;
    constexpr int record = WorkRecord::count + (sizeof(Real) == 4 ? StateRecord::count_compensated : StateRecord::count);
    const std::ptrdiff_t under_way = std::min(plan.cloth.rows, 4 * rows_between_stages);
    const std::ptrdiff_t bytes = under_way * plan.cloth.columns * record * std::ptrdiff_t(sizeof(Real));
    return bytes <= 2 * bytes_kept_in_cache ? 1 : int((bytes + bytes_kept_in_cache - 1) / bytes_kept_in_cache);
}

// The positions of `records` records: where padding stays.
template <class Real>
void place_far_away(AlignedVector<Real>& memory, std::ptrdiff_t records, std::ptrdiff_t stride, int lanes) {
    for (std::ptrdiff_t i = 0; i < records; ++i) std::fill_n(memory.begin() + i * stride, 3 * lanes, Real(far_away));
}

inline void relax() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
}

}  // namespace

// Two rows of a neighbour, the one at the border first, for two stages; and the number of the newest stage in it.
template <class Real>
struct Mailbox {
    AlignedVector<Real> rows;
    int lanes = 0, vectors = 0;
    std::ptrdiff_t row_size = 0;
    alignas(64) std::atomic<std::int64_t> newest{-1};

    void prepare(const LiftedLayout& layout) {
        lanes = layout.lanes;
        vectors = layout.vectors;
        row_size = std::max(layout.row_size(), std::ptrdiff_t(vectors) * WorkRecord::count * lanes);
        rows.assign(4 * row_size + lanes, Real(0));
    }
    Real* row(std::int64_t stage, int which) { return rows.data() + ((stage & 1) * 2 + which) * row_size; }
    void wait(std::int64_t stage) const {
        for (int spins = 0; spins < spins_before_sleep; ++spins) {
            if (newest.load(std::memory_order_acquire) >= stage) return;
            relax();
        }
        for (auto seen = newest.load(std::memory_order_acquire); seen < stage; seen = newest.load(std::memory_order_acquire))
            newest.wait(seen, std::memory_order_acquire);
    }
    // Of a row only the state is copied; `stride` is that of the rows the stage will look at.
    void put(std::int64_t stage, const Real* border, const Real* second, std::ptrdiff_t stride) {
        for (int k = 0; k < vectors; ++k) {
            std::copy_n(border + k * stride, 6 * lanes, row(stage, 0) + k * stride);
            std::copy_n(second + k * stride, 6 * lanes, row(stage, 1) + k * stride);
        }
        newest.store(stage, std::memory_order_release);
        newest.notify_one();
    }
};

template <class Real>
struct EdgeEngine<Real>::Band {
    EdgeEngine* engine;
    int strip;
    int begin, end;
    bool upwards;
    Band* near = nullptr;  // the neighbour at the border where sweeps begin
    Band* far = nullptr;   // the one where they end
    Mailbox<Real> from_near, from_far;
    AlignedVector<Real> scratch, work;
    std::vector<EdgeRowPointers<Real>> rows;  // in the order of the sweep
    int lag;                                  // rows between two stages; all rows: stage by stage
    EdgeArguments<Real> stages[4];
    std::vector<Contact> contacts;
    std::vector<SphereOutline<Real>> outlines;

    std::ptrdiff_t work_stride() const { return WorkRecord::count * engine->layout_.lanes; }
    int size() const { return end - begin; }
    int cloth_row(int row) const { return upwards ? end - 1 - row : begin + row; }
    const Real* source(Stage stage, int row) const {
        return stage == Stage::first ? rows[std::size_t(row)].state : rows[std::size_t(row)].work;
    }
    // Hand two rows that are done to the mailbox of a neighbour, which looks at them in stage `number`.
    void hand(Mailbox<Real>& box, std::int64_t number, Stage done, int border, int second) const {
        const bool whole = done == Stage::fourth;
        const auto row = [&](int r) { return whole ? rows[std::size_t(r)].state : rows[std::size_t(r)].work; };
        box.put(number, row(border), row(second), whole ? engine->layout_.stride : work_stride());
    }

    static void hit(void* context, int sphere, int row, int vector, std::uint64_t lanes) {
        Band& band = *static_cast<Band*>(context);
        const LiftedLayout& layout = band.engine->layout_;
        for (; lanes != 0; lanes &= lanes - 1) {
            const int column = layout.first_column(band.strip) + __builtin_ctzll(lanes) * layout.vectors + vector;
            if (column >= layout.owned_begin(band.strip) && column < layout.owned_begin(band.strip + 1))
                band.engine->answer(band.contacts[std::size_t(sphere)], band.cloth_row(row), column);
        }
    }

    void place_spheres(double t) {
        contacts = engine->contacts(t);
        outlines.clear();
        for (const Contact& contact : contacts)
            outlines.push_back({{Real(contact.center[0]), Real(contact.center[1]), Real(contact.center[2])},
                                Base::outer_radius_squared(contact.sphere)});
    }
};

template <class Real>
EdgeEngine<Real>::EdgeEngine(const Plan& plan)
    : Base(plan, LiftedLayout(plan.cloth, kernels_of<Real>(*plan.kernels).lanes, Base::compensated, strips_of<Real>(plan)), 0) {
    const Cloth& cloth = plan_.cloth;
    const RealKernels<Real>& kernels = kernels_of<Real>(*plan_.kernels);
    const int features = plan_.features().index();
    stage_kernel_ = kernels.edge_stage[features];
    waves_kernel_ = kernels.edge_waves[features];
    halo_kernel_ = kernels.edge_halo[features];
    finish_kernel_ = kernels.edge_finish;

    // An unaligned load behind the last vector may read one lane past the last record.
    memory_.assign(layout_.size() + layout_.lanes, Real(0));
    const std::ptrdiff_t all_rows = std::ptrdiff_t(layout_.strips) * cloth.rows;
    place_far_away(memory_, all_rows * layout_.vectors, layout_.stride, layout_.lanes);

    free_.assign(all_rows * layout_.width(), Real(0));
    if (!cloth.uniform_mass) inverse_mass_.assign(free_.size(), Real(0));
    row_has_fixed_.assign(all_rows, layout_.strip_columns() != layout_.width());
    for (std::ptrdiff_t r = 0; r < all_rows; ++r)
        for (int c = 0; c < layout_.strip_columns(); ++c) {
            const int point = int(r % cloth.rows) * cloth.columns + layout_.first_column(int(r / cloth.rows)) + c;
            const std::ptrdiff_t place = r * layout_.width() + layout_.in_row(c);
            free_[place] = Real(cloth.pinned[point] ? 0 : 1);
            row_has_fixed_[r] |= cloth.pinned[point];
            if (!cloth.uniform_mass) inverse_mass_[place] = Real(1 / cloth.mass[point]);
        }
    for (int s = 0; s + 1 < layout_.strips; ++s) {
        const std::ptrdiff_t overlap = layout_.first_column(s) + layout_.width() - layout_.first_column(s + 1);
        seam_size_ = std::max(seam_size_, 6 * overlap);
    }
    seams_.assign(seam(0, 0, 2), Real(0));
    build_coefficients();
}

template <class Real>
EdgeEngine<Real>::~EdgeEngine() = default;

// The stiffness rounded so that a spring at rest gives no force (see exact_at_rest); as it is where rounding is not
// all there is between the two, as with a rest length of 0.
template <class Real>
Real EdgeEngine<Real>::stiffness_at_rest(const Neighbour& neighbour, Real stiffness, Real tension) const {
    if (!exact_at_rest<Real>) return stiffness;
    const Cloth& cloth = plan_.cloth;
    const Real r = kernels_of<Real>(*plan_.kernels)
                       .rest_length(Real(neighbour.column * cloth.column_spacing), Real(neighbour.row * cloth.row_spacing))
                       .reciprocal;
    const Real at_rest = tension * r;
    return std::abs(at_rest - stiffness) <= 16 * std::numeric_limits<Real>::epsilon() * stiffness ? at_rest : stiffness;
}

template <class Real>
void EdgeEngine<Real>::build_coefficients() {
    const Cloth& cloth = plan_.cloth;
    const double scale = this->coefficient_scale();
    const double root_scale = double(kernels_of<Real>(*plan_.kernels).root_scale);
    constexpr struct {
        EdgeKind kind;
        Neighbour neighbour;
    } kinds[edge_kind_count] = {{to_right, {0, 1, structural}},
                                {to_right_2, {0, 2, bend}},
                                {to_below, {1, 0, structural}},
                                {to_diagonal, {1, 1, shear}},
                                {to_below_2, {2, 0, bend}}};

    // Damping that is the same for all families is taken out of the springs, which saves a product each.
    double most_damping = 0, most_stiffness = 0;
    for (int f = 0; f < family_count; ++f)
        if (cloth.present[f]) {
            most_damping = std::max(most_damping, cloth.spring_damping[f]);
            most_stiffness = std::max(most_stiffness, cloth.stiffness[f]);
        }
    bool alike = true;
    for (int f = 0; f < family_count; ++f) alike &= !cloth.present[f] || cloth.spring_damping[f] == most_damping;
    const double unit = most_damping * scale / (root_scale * root_scale);
    const bool damped = most_damping > 0;
    // A quotient of stiffness and damping that single cannot hold is not worth it.
    const bool fold = damped && alike && most_stiffness * scale <= 1e15 * unit && unit < 1e15;
    force_scale_ = fold ? unit : 1;
    complete_ = layout_.strip_columns() == layout_.width() && (!damped || fold);

    // Vectors whose lanes have the same springs share a class; there are few. The first has them all.
    std::map<std::vector<int>, int> classes;
    const auto class_of = [&](const std::vector<int>& reach) {
        const auto [found, is_new] = classes.try_emplace(reach, int(classes.size()));
        if (!is_new) return found->second;
        for (const auto& [kind, neighbour] : kinds)
            for (const int what : {0, 1, 2})
                for (const int follow : reach) {
                    const bool there = follow >= neighbour.column;
                    const double stiffness = cloth.stiffness[neighbour.family] * scale / force_scale_;
                    const Real tension = Real(stiffness * cloth.rest_length(neighbour) / root_scale);
                    const double damping = cloth.spring_damping[neighbour.family] * scale / (root_scale * root_scale) / force_scale_;
                    const Real value = what == EdgeCoefficientIndex::stiffness ? stiffness_at_rest(neighbour, Real(stiffness), tension)
                                       : what == EdgeCoefficientIndex::tension ? tension
                                                                               : Real(damping);
                    coefficients_.push_back(there ? value : Real(0));
                }
        return found->second;
    };
    class_of(std::vector<int>(std::size_t(layout_.lanes), 2));
    for (int k = 0; k < layout_.vectors; ++k) {
        std::vector<int> reach;  // per lane, how many columns follow (2: enough for every spring), -1: padding
        for (int lane = 0; lane < layout_.lanes; ++lane)
            reach.push_back(std::clamp(layout_.strip_columns() - 1 - (lane * layout_.vectors + k), -1, 2));
        coefficient_class_.push_back(std::uint8_t(class_of(reach)));
    }
    for (Real& value : inverse_mass_) value = Real(double(value) * force_scale_);
}

template <class Real>
EdgeArguments<Real> EdgeEngine<Real>::arguments(Band& band, Stage stage, double dt) {
    EdgeArguments<Real> e = arguments(stage, dt, band.scratch.data() + (stage == Stage::evaluate ? 0 : int(stage)) * scratch_size());
    e.rows = band.rows.data();
    e.hit = &Band::hit;
    e.context = &band;
    return e;
}

template <class Real>
EdgeArguments<Real> EdgeEngine<Real>::arguments(Stage stage, double dt, Real* scratch) const {
    EdgeArguments<Real> e{};
    static_cast<StepConstants<Real>&>(e) = this->step_constants(dt);
    e.vectors = layout_.vectors;
    e.stage = stage;
    e.coefficients = coefficients_.data();
    e.coefficient_class = coefficient_class_.data();
    e.force_scale = Real(force_scale_);
    e.point_damping = Real(plan_.cloth.point_damping * this->coefficient_scale() / force_scale_);
    e.complete = complete_;
    e.received[0] = scratch;
    e.received[1] = scratch + handed_size();
    e.received_2 = scratch + 2 * handed_size();
    e.pending = -1;
    e.force = scratch + 3 * handed_size();
    return e;
}

template <class Real>
auto EdgeEngine<Real>::bands(int team) -> std::vector<std::unique_ptr<Band>>& {
    auto& bands = bands_[team];
    if (!bands.empty()) return bands;
    const std::ptrdiff_t work_row = layout_.vectors * WorkRecord::count * layout_.lanes;
    for (int i = 0; i < layout_.strips * team; ++i) {
        const int t = i % team;
        auto band = std::make_unique<Band>();
        band->engine = this;
        band->strip = i / team;
        band->begin = int(std::int64_t(rows()) * t / team);
        band->end = int(std::int64_t(rows()) * (t + 1) / team);
        band->upwards = team > 1 && t % 2 == 0;
        band->from_near.prepare(layout_);
        band->from_far.prepare(layout_);
        band->scratch.assign(4 * scratch_size(), Real(0));

        const int n = band->size();
        const std::ptrdiff_t bytes = n * (layout_.row_size() + work_row) * std::ptrdiff_t(sizeof(Real));
        band->lag = bytes <= bytes_kept_in_cache ? n : rows_between_stages;
        const int ring = std::min(n, 3 * band->lag + 3);
        band->work.assign(ring * work_row + layout_.lanes, Real(0));
        place_far_away(band->work, ring * layout_.vectors, band->work_stride(), layout_.lanes);
        for (int j = 0; j < n; ++j) {
            const std::ptrdiff_t r = std::ptrdiff_t(band->strip) * rows() + band->cloth_row(j);
            band->rows.push_back({memory_.data() + r * layout_.row_size(), band->work.data() + j % ring * work_row,
                                  free_.data() + r * layout_.width(),
                                  inverse_mass_.empty() ? nullptr : inverse_mass_.data() + r * layout_.width(),
                                  is_special(r)});
        }
        bands.push_back(std::move(band));
    }
    for (int i = 0; i < layout_.strips * team; ++i) {
        Band& band = *bands[std::size_t(i)];
        Band* const above = i % team > 0 ? bands[std::size_t(i - 1)].get() : nullptr;
        Band* const below = i % team + 1 < team ? bands[std::size_t(i + 1)].get() : nullptr;
        band.near = band.upwards ? below : above;
        band.far = band.upwards ? above : below;
    }
    return bands;
}

// Calls `visit(seam, column, place in the row of the strip)` for the columns of a strip's row that lie in a seam and that
// it owns, or does not own.
template <class Visit>
void for_each_in_seams(const LiftedLayout& layout, int strip, bool owned, Visit visit) {
    const int first = layout.first_column(strip);
    const auto columns = [&](int seam, int begin, int end) {
        const int start = layout.first_column(seam + 1);
        int vector = (begin - first) % layout.vectors, lane = (begin - first) / layout.vectors;
        for (int c = begin; c < end; ++c) {
            visit(seam, c - start, vector * layout.stride + lane);
            if (++vector == layout.vectors) vector = 0, ++lane;
        }
    };
    if (strip > 0) {
        const int middle = layout.owned_begin(strip), end = layout.first_column(strip - 1) + int(layout.width());
        columns(strip - 1, owned ? middle : first, owned ? end : middle);
    }
    if (strip + 1 < layout.strips) {
        const int middle = layout.owned_begin(strip + 1), begin = layout.first_column(strip + 1);
        columns(strip, owned ? begin : middle, owned ? middle : first + int(layout.width()));
    }
}

template <class Real>
void EdgeEngine<Real>::to_seams(const Real* state, int strip, int row, int parity) {
    for_each_in_seams(layout_, strip, true, [&](int s, int column, std::ptrdiff_t place) {
        Real* const p = seams_.data() + seam(s, row, parity) + 6 * column;
        for (int k = 0; k < 6; ++k) p[k] = state[place + k * layout_.lanes];
    });
}

// What compensation holds is not of interest to other columns.
template <class Real>
void EdgeEngine<Real>::from_seams(Real* state, int strip, int row, int parity) const {
    for_each_in_seams(layout_, strip, false, [&](int s, int column, std::ptrdiff_t place) {
        const Real* const p = seams_.data() + seam(s, row, parity) + 6 * column;
        for (int k = 0; k < 6; ++k) state[place + k * layout_.lanes] = p[k];
    });
}

// Before the first of some steps, counted from 0, and after a change of the state from elsewhere.
template <class Real>
void EdgeEngine<Real>::know_seams(int begin, int end, std::int64_t step) {
    if (layout_.strips == 1 || this->acceleration_known_) return;
    for (int s = 0; s < layout_.strips; ++s)
        for (int r = begin; r < end; ++r)
            to_seams(memory_.data() + (std::ptrdiff_t(s) * rows() + r) * layout_.row_size(), s, r, int(parity_ + step) & 1);
}

// The step whose first stage has this number, for one band of one strip.
template <class Real>
void EdgeEngine<Real>::run_step(Band& band, std::int64_t number, double t) {
    const int n = band.size();
    EdgeArguments<Real>* const stages = band.stages;
    const bool in_strips = layout_.strips > 1;
    const int parity = int(parity_ + number / 4) & 1;
    int fetched = 0, left = 0;  // rows whose halo has come from the seams; that have been left there

    const auto fetch = [&](int row) { from_seams(band.rows[std::size_t(row)].state, band.strip, band.cloth_row(row), parity); };
    const auto fetch_until = [&](int end) {
        for (; in_strips && fetched < std::min(end, n); ++fetched) fetch(fetched);
    };
    const auto leave_until = [&](int end) {
        for (; in_strips && left < end; ++left)
            to_seams(band.rows[std::size_t(left)].state, band.strip, band.cloth_row(left), parity ^ 1);
    };

    // A stage begins with what the rows before the band hand on.
    const auto begin_at_edge = [&](int s) {
        std::fill_n(stages[s].received[0], handed_size(), Real(0));
        std::fill_n(stages[s].received_2, handed_size(), Real(0));
    };
    const auto begin_at_border = [&](int s) {
        EdgeArguments<Real>& e = stages[s];
        band.from_near.wait(number + s);
        const Real* const first = band.source(e.stage, 0);
        halo_kernel_(e, {band.from_near.row(number + s, 1), nullptr, first},
                     {band.from_near.row(number + s, 0), first, band.source(e.stage, 1)});
    };
    // After the last stage the halos have to be fetched first, so rows are handed over as the next step begins.
    const auto hands_on = [&](int s) { return !in_strips || s < 3; };
    const auto run_row = [&](int s, int row) {
        EdgeArguments<Real>& e = stages[s];
        if (row == 0 && band.near) begin_at_border(s);
        const auto source = [&](int r) -> const Real* {
            if (r < n) return band.source(e.stage, r);
            if (!band.far) return nullptr;
            band.from_far.wait(number + s);
            return band.from_far.row(number + s, r - n);
        };
        stage_kernel_(e, row, {source(row), source(row + 1), source(row + 2)});
        if (row == 2 && band.near && hands_on(s))
            band.hand(band.near->from_near, number + s + 1, e.stage, 0, 1);
        if (row < n - 1) return;
        finish_kernel_(e);
        if (band.far && hands_on(s)) band.hand(band.far->from_far, number + s + 1, e.stage, n - 1, n - 2);
    };
    // Rows that need neither neighbour are left to the kernel in one go.
    const int first_inner = band.near ? std::min(3, n) : 0, end_inner = std::max(first_inner, n - 2);

    if (in_strips && (band.near || band.far)) {
        for (const int row : {0, 1, n - 2, n - 1}) fetch(row);
        if (band.near) band.hand(band.near->from_near, number, Stage::fourth, 0, 1);
        if (band.far) band.hand(band.far->from_far, number, Stage::fourth, n - 1, n - 2);
    }
    if (!plan_.spheres.empty() && !this->track_contact_energy) {
        band.place_spheres(t);
        stages[3].spheres = band.outlines.data();
        stages[3].sphere_count = int(band.outlines.size());
    }
    if (!band.near)
        for (int s = 0; s < 4; ++s) begin_at_edge(s);
    if (band.lag >= n) {
        fetch_until(n);
        for (int s = 0; s < 4; ++s) {
            for (int row = 0; row < first_inner; ++row) run_row(s, row);
            waves_kernel_(stages + s, 1, 0, first_inner, end_inner);
            for (int row = end_inner; row < n; ++row) run_row(s, row);
        }
    } else {
        const int begin_bulk = first_inner + 3 * band.lag;
        for (int front = 0; front < n + 3 * band.lag; ++front) {
            while (front >= begin_bulk && front < end_inner) {
                const int end = in_strips ? front + 1 : end_inner;
                fetch_until(end + 2);
                waves_kernel_(stages, 4, band.lag, front, end);
                front = end;
                leave_until(front - 3 * band.lag - 1);
            }
            fetch_until(front + 3);
            for (int s = 0; s < 4; ++s) {
                const int row = front - s * band.lag;
                if (row >= 0 && row < n) run_row(s, row);
            }
        }
    }
    leave_until(n);
}

template <class Real>
void EdgeEngine<Real>::run_bands(int team, int thread, std::int64_t steps, const Clock& clock) {
    const auto& all = bands(team);
    for (std::size_t i = std::size_t(thread); i < all.size(); i += std::size_t(team))
        for (int s = 0; s < 4; ++s) all[i]->stages[s] = arguments(*all[i], Stage(s), clock.dt);
    const bool tracked = this->track_contact_energy;
    for (std::int64_t k = 0; k < steps; ++k) {
        if (k == 0 || tracked) know_seams(all[std::size_t(thread)]->begin, all[std::size_t(thread)]->end, k);
        for (std::size_t i = std::size_t(thread); i < all.size(); i += std::size_t(team)) run_step(*all[i], 4 * k, clock.at(k + 1));
        if (tracked) {
            this->collide_all(clock.at(k + 1));
            this->acceleration_known_ = false;
        }
    }
}

template <class Real>
void EdgeEngine<Real>::advance(std::int64_t steps, const Clock& clock, int threads) {
    const int team = this->track_contact_energy ? 1 : std::min(threads, rows() / fewest_rows_per_band);
    if (team <= 1) {
        run_bands(1, 0, steps, clock);
    } else {
#pragma omp parallel num_threads(team)
        {
            // As many bands as threads were really given: a band without a thread would be waited for.
#pragma omp single
            {
                auto& all = bands(omp_get_num_threads());
                for (auto& band : all) {
                    band->from_near.newest.store(-1, std::memory_order_relaxed);
                    band->from_far.newest.store(-1, std::memory_order_relaxed);
                }
                for (auto& band : all) {
                    if (layout_.strips > 1) break;
                    const int n = band->size();
                    if (band->near) band->hand(band->near->from_near, 0, Stage::fourth, 0, 1);
                    if (band->far) band->hand(band->far->from_far, 0, Stage::fourth, n - 1, n - 2);
                }
            }
            run_bands(omp_get_num_threads(), omp_get_thread_num(), steps, clock);
        }
    }
    parity_ = int(parity_ + steps) & 1;
    this->acceleration_known_ = !this->track_contact_energy;
}

template <class Real>
void EdgeEngine<Real>::accelerations(double* a, int) {
    know_seams(0, rows(), 0);
    for (int strip = 0; strip < layout_.strips; ++strip) {
        Band& band = *bands(1)[std::size_t(strip)];
        if (layout_.strips > 1)
            for (int r = 0; r < rows(); ++r) from_seams(band.rows[std::size_t(r)].state, strip, r, parity_);
        EdgeArguments<Real> e = arguments(band, Stage::evaluate, 0);
        std::fill_n(e.received[0], 3 * handed_size(), Real(0));
        for (int r = 0; r < rows(); ++r) {
            const auto state = [&](int row) -> const Real* {
                return row < rows() ? band.rows[std::size_t(row)].state : nullptr;
            };
            stage_kernel_(e, r, {state(r), state(r + 1), state(r + 2)});
            finish_kernel_(e);
            const Real* const work = band.rows[std::size_t(r)].work;
            for (int c = layout_.owned_begin(strip); c < layout_.owned_begin(strip + 1); ++c) {
                const int local = c - layout_.first_column(strip);
                const Real* const from = work + local % layout_.vectors * band.work_stride() + WorkRecord::first * layout_.lanes + local / layout_.vectors;
                for (int k = 0; k < 3; ++k) a[3 * (std::ptrdiff_t(r) * columns() + c) + k] = double(from[k * layout_.lanes]);
            }
        }
    }
}

template class EdgeEngine<float>;
template class EdgeEngine<double>;

}  // namespace clothsim
