// How bands work side by side without a barrier.
//
// Every thread sweeps its band of rows downwards, stage after stage. A sweep needs the two rows above the
// band when it begins and the two rows below when it ends; a thread therefore hands its first two rows up as
// soon as they are done and its last two down at the end. The thread below so runs a little behind the one
// above, and once it does, nobody waits any more: what a thread needs has been there for most of a stage.
//
// The rows go through mailboxes with two slots, by the parity of the stage. Two are enough: a thread can
// finish a stage only with its neighbours' rows of the stage before, so it is never two stages ahead.
#include "simulation/edge_engine.hpp"

#include <omp.h>
#include <sched.h>

#include <map>

namespace clothsim {
namespace {

constexpr int fewest_rows_per_band = 4;
constexpr int spins_before_yield = 20000;

inline void relax() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
}

}  // namespace

// Two rows of source planes from a neighbour, for two stages, and the number of the newest stage in it.
template <class Real>
struct Mailbox {
    AlignedVector<Real> rows;
    std::ptrdiff_t row_size = 0;
    alignas(64) std::atomic<std::int64_t> newest{-1};

    void prepare(std::ptrdiff_t size) {
        row_size = size;
        rows.assign(4 * size + 16, Real(0));
    }
    Real* row(std::int64_t stage, int which) { return rows.data() + ((stage & 1) * 2 + which) * row_size; }
    void wait(std::int64_t stage) const {
        for (int spins = 0; newest.load(std::memory_order_acquire) < stage; ++spins) {
            relax();
            if (spins > spins_before_yield) sched_yield();
        }
    }
    void start(const Real* first, const Real* second) {
        newest.store(-1, std::memory_order_relaxed);
        put(0, first, second);
    }
    void put(std::int64_t stage, const Real* first, const Real* second) {
        std::copy_n(first, row_size, row(stage, 0));
        std::copy_n(second, row_size, row(stage, 1));
        newest.store(stage, std::memory_order_release);
    }
};

template <class Real>
struct EdgeEngine<Real>::Band {
    EdgeEngine* engine;
    int begin, end;
    Band* above = nullptr;
    Band* below = nullptr;
    Mailbox<Real> from_above, from_below;
    AlignedVector<Real> scratch;
    std::vector<EdgeSources<Real>> of_state, of_stage;
    std::vector<Contact> contacts;
    std::vector<SphereOutline<Real>> outlines;

    int size() const { return end - begin; }

    static void hit(void* context, int sphere, int row, int vector, std::uint64_t lanes) {
        Band& band = *static_cast<Band*>(context);
        const int vectors = band.engine->layout_.vectors;
        for (; lanes != 0; lanes &= lanes - 1)
            band.engine->answer(band.contacts[std::size_t(sphere)], band.begin + row,
                                __builtin_ctzll(lanes) * vectors + vector);
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
    : Base(plan, LiftedLayout(plan.cloth, kernels_of<Real>(*plan.kernels).lanes, Base::compensated), 0) {
    const Cloth& cloth = plan_.cloth;
    const RealKernels<Real>& kernels = kernels_of<Real>(*plan_.kernels);
    rows_kernel_ = kernels.edge_rows[plan_.features().index()];
    halo_kernel_ = kernels.edge_halo[plan_.features().index()];

    // An unaligned load behind the last vector reads one lane past the last plane.
    memory_.assign(cloth.rows * layout_.record + layout_.lanes, Real(0));
    for (int r = 0; r < cloth.rows; ++r)
        for (const int planes : {RowPlanes::state, RowPlanes::stage})
            std::fill_n(row_planes(r, planes), 3 * layout_.plane, Real(far_away));

    free_.assign(cloth.rows * layout_.plane, Real(0));
    if (!cloth.uniform_mass) inverse_mass_.assign(free_.size(), Real(0));
    row_has_fixed_.assign(cloth.rows, cloth.columns != layout_.plane);
    for (int r = 0; r < cloth.rows; ++r)
        for (int c = 0; c < cloth.columns; ++c) {
            const int point = r * cloth.columns + c;
            const std::ptrdiff_t place = r * layout_.plane + layout_.in_plane(c);
            free_[place] = Real(cloth.pinned[point] ? 0 : 1);
            row_has_fixed_[r] |= cloth.pinned[point];
            if (!cloth.uniform_mass) inverse_mass_[place] = Real(1 / cloth.mass[point]);
        }
    build_coefficients();
}

template <class Real>
EdgeEngine<Real>::~EdgeEngine() = default;

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

    // Vectors whose lanes have the same springs share a class; there are few.
    std::map<std::vector<int>, int> classes;
    coefficient_class_.resize(std::size_t(layout_.vectors));
    for (int k = 0; k < layout_.vectors; ++k) {
        std::vector<int> reach;  // per lane, how many columns follow (2: enough for every spring), -1: padding
        for (int lane = 0; lane < layout_.lanes; ++lane)
            reach.push_back(std::clamp(cloth.columns - 1 - (lane * layout_.vectors + k), -1, 2));
        const auto [found, is_new] = classes.try_emplace(reach, int(classes.size()));
        coefficient_class_[std::size_t(k)] = std::uint8_t(found->second);
        if (!is_new) continue;
        for (const auto& [kind, neighbour] : kinds)
            for (const int what : {0, 1, 2})
                for (const int follow : reach) {
                    const bool there = follow >= neighbour.column;
                    const double stiffness = cloth.stiffness[neighbour.family] * scale;
                    const double value = what == EdgeCoefficientIndex::stiffness ? stiffness
                                         : what == EdgeCoefficientIndex::tension
                                             ? stiffness * cloth.rest_length(neighbour) / root_scale
                                             : cloth.spring_damping[neighbour.family] * scale / (root_scale * root_scale);
                    coefficients_.push_back(Real(there ? value : 0));
                }
    }
}

template <class Real>
EdgeArguments<Real> EdgeEngine<Real>::arguments(Band& band, double dt) {
    EdgeArguments<Real> e{};
    e.rows = row_planes(band.begin, 0);
    e.inverse_mass = inverse_mass_.empty() ? nullptr : inverse_mass_.data() + band.begin * layout_.plane;
    e.free = free_.data() + band.begin * layout_.plane;
    e.row_has_fixed = row_has_fixed_.data() + band.begin;
    e.received = band.scratch.data();
    e.received_2 = e.received + 3 * layout_.plane;
    e.force = e.received_2 + 3 * layout_.plane;
    e.context = &band;
    e.vectors = layout_.vectors;
    e.record = layout_.record;
    e.coefficients = coefficients_.data();
    e.coefficient_class = coefficient_class_.data();
    for (int k = 0; k < 3; ++k) e.gravity[k] = Real(plan_.gravity[k]);
    e.half_h = Real(dt / 2);
    e.h = Real(dt);
    e.h2_6 = Real(dt * dt / 6);
    e.h_6 = Real(dt / 6);
    e.point_damping = Real(plan_.cloth.point_damping * this->coefficient_scale());
    e.hit = &Band::hit;
    return e;
}

template <class Real>
void EdgeEngine<Real>::form_bands(int team) {
    if (int(bands_.size()) == team) return;
    bands_.clear();
    for (int t = 0; t < team; ++t) {
        auto band = std::make_unique<Band>();
        band->engine = this;
        band->begin = int(std::int64_t(rows()) * t / team);
        band->end = int(std::int64_t(rows()) * (t + 1) / team);
        band->from_above.prepare(6 * layout_.plane);
        band->from_below.prepare(6 * layout_.plane);
        band->scratch.assign(9 * layout_.plane, Real(0));
        bands_.push_back(std::move(band));
    }
    for (int t = 0; t < team; ++t) {
        Band& band = *bands_[std::size_t(t)];
        if (t > 0) band.above = bands_[std::size_t(t - 1)].get();
        if (t + 1 < team) band.below = bands_[std::size_t(t + 1)].get();
        for (const int planes : {RowPlanes::state, RowPlanes::stage}) {
            auto& sources = planes == RowPlanes::state ? band.of_state : band.of_stage;
            const auto own = [&](int row) { return row < band.end ? row_planes(row, planes) : nullptr; };
            for (int row = band.begin; row < band.end; ++row) sources.push_back({own(row), own(row + 1), own(row + 2)});
        }
    }
}

template <class Real>
void EdgeEngine<Real>::run_band(int index, std::int64_t steps, const Clock& clock) {
    Band& band = *bands_[std::size_t(index)];
    const int n = band.size();
    const bool tracked = this->track_contact_energy;
    EdgeArguments<Real> e = arguments(band, clock.dt);
    std::int64_t number = 0;  // of the stage in this call
    for (std::int64_t k = 1; k <= steps; ++k) {
        if (!plan_.spheres.empty() && !tracked) {
            band.place_spheres(clock.at(k));
            e.spheres = band.outlines.data();
            e.sphere_count = int(band.outlines.size());
        }
        for (const Stage stage : {Stage::first, Stage::second, Stage::third, Stage::fourth}) {
            e.stage = stage;
            const int target = stage == Stage::fourth ? RowPlanes::state : RowPlanes::stage;
            std::vector<EdgeSources<Real>>& sources = stage == Stage::first ? band.of_state : band.of_stage;

            if (band.above) {
                band.from_above.wait(number);
                halo_kernel_(e, {band.from_above.row(number, 0), nullptr, sources[0].here},
                             {band.from_above.row(number, 1), sources[0].here, sources[1].here});
            } else {
                std::fill_n(e.received, 6 * layout_.plane, Real(0));
            }
            rows_kernel_(e, sources.data(), 0, std::min(2, n));
            if (band.above)
                band.above->from_below.put(number + 1, row_planes(band.begin, target), row_planes(band.begin + 1, target));
            if (band.below) {
                rows_kernel_(e, sources.data(), 2, n - 2);
                band.from_below.wait(number);
                sources[std::size_t(n - 2)].below_2 = band.from_below.row(number, 0);
                sources[std::size_t(n - 1)].below = band.from_below.row(number, 0);
                sources[std::size_t(n - 1)].below_2 = band.from_below.row(number, 1);
                rows_kernel_(e, sources.data(), n - 2, n);
                band.below->from_above.put(number + 1, row_planes(band.end - 2, target), row_planes(band.end - 1, target));
            } else {
                rows_kernel_(e, sources.data(), std::min(2, n), n);
            }
            ++number;
        }
        if (tracked) this->collide_all(clock.at(k));
    }
}

template <class Real>
void EdgeEngine<Real>::advance(std::int64_t steps, const Clock& clock, int threads) {
    const int team = this->track_contact_energy ? 1 : std::min(threads, rows() / fewest_rows_per_band);
    if (team <= 1) {
        form_bands(1);
        run_band(0, steps, clock);
        return;
    }
#pragma omp parallel num_threads(team)
    {
        // As many bands as threads were really given: a band without a thread would be waited for.
#pragma omp single
        {
            form_bands(omp_get_num_threads());
            for (auto& band : bands_) {
                const auto row = [&](int r) { return row_planes(r, RowPlanes::state); };
                if (band->above) band->above->from_below.start(row(band->begin), row(band->begin + 1));
                if (band->below) band->below->from_above.start(row(band->end - 2), row(band->end - 1));
            }
        }
        run_band(omp_get_thread_num(), steps, clock);
    }
}

template <class Real>
void EdgeEngine<Real>::accelerations(double* a, int) {
    form_bands(1);
    Band& band = *bands_[0];
    EdgeArguments<Real> e = arguments(band, 0);
    e.stage = Stage::evaluate;
    std::fill_n(e.received, 6 * layout_.plane, Real(0));
    rows_kernel_(e, band.of_state.data(), 0, rows());
    for (int r = 0; r < rows(); ++r)
        for (int c = 0; c < columns(); ++c)
            for (int k = 0; k < 3; ++k) *a++ = double(memory_[layout_.at(r, c, RowPlanes::first + k)]);
}

template class EdgeEngine<float>;
template class EdgeEngine<double>;

}  // namespace clothsim
