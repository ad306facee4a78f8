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
// in a ring of rows.
#include "simulation/edge_engine.hpp"

#include <omp.h>

namespace clothsim {
namespace {

constexpr int fewest_rows_per_band = 8;
// Where a band comes near a sphere, planes between the two are looked for no more often than this.
constexpr std::int64_t steps_between_planes = 64;
// A neighbour answers within microseconds unless its processor is taken; then sleeping lets it have this one.
constexpr int spins_before_sleep = 500;

// Rows between two stages that follow each other: a row needs the two after it, and a row is finished by the next.
constexpr int rows_between_stages = 3;

// A band whose state and work fit into this many bytes is swept stage by stage.
constexpr std::ptrdiff_t bytes_kept_in_cache = 768 * 1024;

// A state of more bytes comes from memory in each step. The processor does not see the next row coming, so it is told to
// fetch it; in a cloth that the shared cache holds that costs more than it gains.
constexpr std::ptrdiff_t bytes_in_shared_cache = 4 * 1024 * 1024;

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
    int begin, end;
    bool upwards;
    Band* near = nullptr;  // the neighbour at the border where sweeps begin
    Band* far = nullptr;   // the one where they end
    Mailbox<Real> from_near, from_far;
    AlignedVector<Real> scratch, work;
    std::vector<EdgeRowPointers<Real>> rows;  // in the order of the sweep
    int lag;                                  // rows between two stages; all rows: stage by stage
    std::vector<Contact> contacts;
    std::vector<SphereOutline<Real>> outlines;
    std::int64_t steps_to_planes = 0;  // until planes are looked for again

    // A quarter of a row's state on its way from memory, while the stages of rows before it are worked on. Inlined,
    // because compilers take a function that does no more for one that does nothing, and drop it.
    __attribute__((always_inline)) void prefetch(int row, int quarter) const {
        if (row >= size()) return;
        const std::ptrdiff_t share = engine->layout_.row_size() / 4, line = 64 / std::ptrdiff_t(sizeof(Real));
        const Real* const p = rows[std::size_t(row)].state + quarter * share;
        for (std::ptrdiff_t i = 0; i < share; i += line) __builtin_prefetch(p + i, 0, 2);  // to the second-level cache
    }
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
        const int vectors = band.engine->layout_.vectors;
        for (; lanes != 0; lanes &= lanes - 1)
            band.engine->answer(band.contacts[std::size_t(sphere)], band.cloth_row(row),
                                __builtin_ctzll(lanes) * vectors + vector);
    }

    void place_spheres(double t) {
        engine->contacts(t, contacts);
        outlines.resize(contacts.size(), {{}, 0, -1, false, 0, true});
        bool crossed = false;
        for (std::size_t i = 0; i < contacts.size(); ++i) {
            const Contact& contact = contacts[i];
            SphereOutline<Real>& outline = outlines[i];
            for (int k = 0; k < 3; ++k) outline.center[k] = Real(contact.center[k]);
            outline.radius_squared = Base::outer_radius_squared(contact.sphere);
            crossed |= outline.crossed;
        }
        if (crossed && --steps_to_planes <= 0) find_planes();
        for (std::size_t i = 0; i < contacts.size(); ++i) {
            SphereOutline<Real>& outline = outlines[i];
            if (outline.axis < 0) continue;
            const double center = contacts[i].center[outline.axis], reach = reach_of_plane(contacts[i]);
            outline.plane = Real(outline.above ? center + reach : center - reach);
        }
    }

    // What is as far from the centre along one axis is outside for the kernel's test too, whatever is rounded.
    static double reach_of_plane(const Contact& contact) {
        const double radius = contact.sphere.contact_radius;
        return radius + 1e-6 * (radius + contact.center.cwiseAbs().maxCoeff());
    }

    // For every sphere the plane from which the band is farthest now. Only a guess: each row of each step is asked
    // whether it is beyond.
    void find_planes() {
        steps_to_planes = steps_between_planes;
        const LiftedLayout& layout = engine->layout_;
        Real low[3], high[3];
        std::fill_n(low, 3, std::numeric_limits<Real>::max());
        std::fill_n(high, 3, std::numeric_limits<Real>::lowest());
        for (const EdgeRowPointers<Real>& row : rows)
            for (int k = 0; k < layout.vectors; ++k)
                for (int c = 0; c < 3; ++c) {
                    const Real* const x = row.state + k * layout.stride + c * layout.lanes;
                    for (int l = 0; l < layout.lanes; ++l) {
                        low[c] = std::min(low[c], x[l]);
                        high[c] = std::max(high[c], x[l]);
                    }
                }
        for (std::size_t i = 0; i < contacts.size(); ++i) {
            SphereOutline<Real>& outline = outlines[i];
            outline.axis = -1;
            outline.crossed = true;
            double widest = 0;
            const auto offer = [&](int axis, bool above, double gap) {
                if (!(gap > widest)) return;
                widest = gap;
                outline.axis = axis;
                outline.above = above;
                outline.crossed = false;
            };
            const double reach = reach_of_plane(contacts[i]);
            for (int c = 0; c < 3; ++c) {
                offer(c, true, double(low[c]) - (contacts[i].center[c] + reach));
                offer(c, false, contacts[i].center[c] - reach - double(high[c]));  // never where there is padding
            }
        }
    }
};

template <class Real>
EdgeEngine<Real>::EdgeEngine(const Plan& plan)
    : Base(plan, LiftedLayout(plan.cloth, kernels_of<Real>(*plan.kernels).lanes, Base::compensated), 0) {
    const Cloth& cloth = plan_.cloth;
    const RealKernels<Real>& kernels = kernels_of<Real>(*plan_.kernels);
    const int features = plan_.features().index();
    stage_kernel_ = kernels.edge_stage[features];
    waves_kernel_ = kernels.edge_waves[features];
    halo_kernel_ = kernels.edge_halo[features];
    finish_kernel_ = kernels.edge_finish;

    // An unaligned load behind the last vector may read one lane past the last record.
    memory_.assign(cloth.rows * layout_.row_size() + layout_.lanes, Real(0));
    place_far_away(memory_, cloth.rows * layout_.vectors, layout_.stride, layout_.lanes);

    free_.assign(cloth.rows * layout_.width(), Real(0));
    if (!cloth.uniform_mass) inverse_mass_.assign(free_.size(), Real(0));
    row_has_fixed_.assign(cloth.rows, cloth.columns != layout_.width());
    for (int r = 0; r < cloth.rows; ++r)
        for (int c = 0; c < cloth.columns; ++c) {
            const int point = r * cloth.columns + c;
            const std::ptrdiff_t place = r * layout_.width() + layout_.in_row(c);
            free_[place] = Real(cloth.pinned[point] ? 0 : 1);
            row_has_fixed_[r] |= cloth.pinned[point];
            if (!cloth.uniform_mass) inverse_mass_[place] = Real(1 / cloth.mass[point]);
        }
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
    complete_ = cloth.columns == layout_.width() && (!damped || fold);

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
            reach.push_back(std::clamp(cloth.columns - 1 - (lane * layout_.vectors + k), -1, 2));
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
    for (int t = 0; t < team; ++t) {
        auto band = std::make_unique<Band>();
        band->engine = this;
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
        for (int i = 0; i < n; ++i) {
            const int r = band->cloth_row(i);
            band->rows.push_back({memory_.data() + r * layout_.row_size(), band->work.data() + i % ring * work_row,
                                  free_.data() + r * layout_.width(),
                                  inverse_mass_.empty() ? nullptr : inverse_mass_.data() + r * layout_.width(),
                                  is_special(r)});
        }
        bands.push_back(std::move(band));
    }
    for (int t = 0; t < team; ++t) {
        Band& band = *bands[std::size_t(t)];
        Band* const above = t > 0 ? bands[std::size_t(t - 1)].get() : nullptr;
        Band* const below = t + 1 < team ? bands[std::size_t(t + 1)].get() : nullptr;
        band.near = band.upwards ? below : above;
        band.far = band.upwards ? above : below;
    }
    return bands;
}

template <class Real>
void EdgeEngine<Real>::run_band(Band& band, std::int64_t steps, const Clock& clock) {
    const int n = band.size();
    const bool tracked = this->track_contact_energy;
    EdgeArguments<Real> stages[4];
    for (int s = 0; s < 4; ++s) stages[s] = arguments(band, Stage(s), clock.dt);
    std::int64_t number = 0;  // of the step's first stage in this call

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
        if (row == 2 && band.near)
            band.hand(band.near->from_near, number + s + 1, e.stage, 0, 1);
        if (row < n - 1) return;
        finish_kernel_(e);
        if (band.far) band.hand(band.far->from_far, number + s + 1, e.stage, n - 1, n - 2);
    };
    const bool from_memory = std::ptrdiff_t(memory_.size() * sizeof(Real)) > bytes_in_shared_cache;
    // Rows that need neither neighbour are left to the kernel in one go.
    const int first_inner = band.near ? std::min(3, n) : 0, end_inner = std::max(first_inner, n - 2);

    for (std::int64_t k = 1; k <= steps; ++k, number += 4) {
        if (!plan_.spheres.empty() && !tracked) {
            band.place_spheres(clock.at(k));
            stages[3].spheres = band.outlines.data();
            stages[3].sphere_count = int(band.outlines.size());
        }
        if (!band.near)
            for (int s = 0; s < 4; ++s) begin_at_edge(s);
        if (band.lag >= n) {
            for (int s = 0; s < 4; ++s) {
                for (int row = 0; row < first_inner; ++row) run_row(s, row);
                waves_kernel_(stages + s, 1, 0, first_inner, end_inner);
                for (int row = end_inner; row < n; ++row) run_row(s, row);
            }
        } else {
            const int begin_bulk = first_inner + 3 * band.lag;
            for (int front = 0; front < n + 3 * band.lag; ++front) {
                const bool bulk = front >= begin_bulk && front < end_inner;
                if (bulk && !from_memory) {
                    waves_kernel_(stages, 4, band.lag, front, end_inner);
                    front = end_inner - 1;
                    continue;
                }
                for (int s = 0; s < 4; ++s) {
                    const int row = front - s * band.lag;
                    if (from_memory) band.prefetch(front + rows_between_stages, s);
                    if (bulk) waves_kernel_(stages + s, 1, 0, row, row + 1);
                    else if (row >= 0 && row < n) run_row(s, row);
                }
            }
        }
        if (tracked) this->collide_all(clock.at(k));
    }
}

template <class Real>
void EdgeEngine<Real>::advance(std::int64_t steps, const Clock& clock, int threads) {
    const int team = this->track_contact_energy ? 1 : std::min(threads, rows() / fewest_rows_per_band);
    if (team <= 1) {
        run_band(*bands(1)[0], steps, clock);
        return;
    }
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
                const int n = band->size();
                if (band->near) band->hand(band->near->from_near, 0, Stage::fourth, 0, 1);
                if (band->far) band->hand(band->far->from_far, 0, Stage::fourth, n - 1, n - 2);
            }
        }
        run_band(*bands(omp_get_num_threads())[std::size_t(omp_get_thread_num())], steps, clock);
    }
}

template <class Real>
void EdgeEngine<Real>::accelerations(double* a, int) {
    Band& band = *bands(1)[0];
    EdgeArguments<Real> e = arguments(band, Stage::evaluate, 0);
    std::fill_n(e.received[0], 3 * handed_size(), Real(0));
    for (int r = 0; r < rows(); ++r) {
        const auto state = [&](int row) -> const Real* {
            return row < rows() ? band.rows[std::size_t(row)].state : nullptr;
        };
        stage_kernel_(e, r, {state(r), state(r + 1), state(r + 2)});
        finish_kernel_(e);
        const Real* const work = band.rows[std::size_t(r)].work;
        for (int c = 0; c < columns(); ++c)
            for (int k = 0; k < 3; ++k) *a++ = double(work[c % layout_.vectors * band.work_stride() + (WorkRecord::first + k) * layout_.lanes + c / layout_.vectors]);
    }
}

template class EdgeEngine<float>;
template class EdgeEngine<double>;

}  // namespace clothsim
