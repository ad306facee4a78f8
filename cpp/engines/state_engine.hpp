// An engine's state in its layout: into it from arrays of points, out of it, inspected, relative to
// which origin; and the contact pass after its steps.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>

#include "contact/contact_pass.hpp"
#include "contact/separating_planes.hpp"
#include "contact/state_points.hpp"
#include "engines/coefficients.hpp"
#include "engines/engine.hpp"
#include "memory/aligned_vector.hpp"
#include "memory/row_band.hpp"
#include "memory/threads.hpp"

namespace clothsim {

// Padding holds a point that is far from every cloth, finite when squared in single, and never
// moves.
inline constexpr double far_away = 1e15;

// A thread's rows where accelerations are evaluated for the integrators of cpp/integrators, with
// data of the engine's sweep.
template <class Real>
struct FieldBand : RowBand {
    EdgeArguments<Real> edge{};
    std::vector<EdgeRowPointers<Real>> pointers;
    AlignedVector<Real> values;
    GatherArguments<Real> gather{};
};

template <class Real, class Layout>
class StateEngine : public Engine {
public:
    bool load(const float* x, const float* v) final { return load_any(x, v); }
    bool load(const double* x, const double* v) final { return load_any(x, v); }
    void store(float* x, float* v) const final { store_any(x, v); }
    void store(double* x, double* v) const final { store_any(x, v); }

    SavedState saved_state() const final {
        SavedState state{{}, origin_, impulses.sums()};
        each_value([&](std::ptrdiff_t at) { state.values.push_back(memory_[at]); });
        return state;
    }
    void set_saved_state(const SavedState& state) final {
        auto next = state.values.begin();
        each_value([&](std::ptrdiff_t at) { memory_[at] = Real(*next++); });
        stop_held_pins();
        set_origin(state.origin);
        state_replaced();
        impulses.go_on(state.impulses);
    }

    void save_checkpoint() final {
        checkpoint_ = memory_;
        tally_at_checkpoint_ = *this;
    }
    void restore_checkpoint() final {
        memory_ = checkpoint_;
        static_cast<Tally&>(*this) = tally_at_checkpoint_;
        state_replaced();
    }

    bool advance_in_contact(std::int64_t steps, const Clock& clock, int threads,
                            bool behind_planes) final {
        if (!has_contacts()) {
            advance(steps, clock, threads);
            return true;
        }
        Clock now = clock;
        for (const std::int64_t end = clock.steps + steps; now.steps < end; ++now.steps) {
            const auto all = [&](int k) { return component(k, 0, rows()); };
            while (
                const std::int64_t clear = behind_planes
                    ? planes_.clear_steps(plan_.spheres, plan_.gravity, now, end - now.steps, all)
                    : 0) {
                planes_.raise();
                advance(clear, now, threads);
                contact_pass_.forget(false);
                if (!planes_.lower()) return false;
                now.steps += clear;
                if (now.steps == end) return true;
            }
            contact_pass_.keep(memory_);
            advance(1, now, threads);
            respond(now.at(0), now.at(1), now.dt, threads);
            if (contact_report.trapped >= 0) break;
        }
        return true;
    }
    void accept_in_contact(double t0, double t1, int threads) final {
        if (!has_contacts()) return adaptive()->accept_step(t1);
        save_checkpoint();
        contact_pass_.keep(memory_);
        adaptive()->accept_step(t1);
        respond(t0, t1, t1 - t0, threads);
        if (contact_report.trapped >= 0) restore_checkpoint();
    }

    void set_sphere(std::size_t sphere, const Vec3& center, const Motion& motion) final {
        plan_.spheres[sphere].center = center;
        plan_.spheres[sphere].motion = motion;
        planes_.drop();
    }
    void set_force(const double* force) final {
        plan_.force = PointsView(force, plan_.cloth.points(), 3);
        apply_force();
        state_known_ = false;
    }
    void place_pins(double t) final {
        if (!plan_.has_driven_pins()) return;
        place_pins(PinTime::at_rest(t), 0, rows(), memory_);
        state_known_ = false;
    }

    std::int64_t first_bad_point(double speed_limit) const final {
        constexpr Real largest = std::numeric_limits<Real>::max();
        const Real limit = Real(std::min(speed_limit, double(largest)));
        if (limit == largest && finite()) return -1;  // the usual case, fast
        const Vec3 mean = limit < largest ? mean_velocity() : Vec3(Vec3::Zero());
        std::int64_t bad_pin = -1;
        for (int i = 0; i < plan_.cloth.points(); ++i) {
            const bool pin = plan_.cloth.pinned[std::size_t(i)];
            for (int k = 0; k < 6; ++k) {
                const double value = memory_[points_.place(i, k)];
                if (k < 3 || pin ? std::abs(value) <= largest
                                 : std::abs(value - mean[k - 3]) <= limit)
                    continue;
                if (!pin) return i;
                bad_pin = i;
            }
        }
        return bad_pin;
    }
    void note_large_cells(double t) final {
        ContactReport::keep_first(contact_report.large_cell, contact_pass_.large_cell(memory_, t));
    }
    bool has_contacts() const final { return !plan_.spheres.empty(); }

protected:
    static constexpr bool compensated = sizeof(Real) == 4;

    StateEngine(const Plan& plan, const Layout& layout, std::ptrdiff_t size)
        : plan_(plan),
          layout_(layout),
          points_(layout_, plan.cloth.columns),
          memory_(std::size_t(size), Real(0)),
          contact_pass_(plan_, layout_, impulses = Impulses(plan_)),
          planes_(kernels()) {
        auto driven = plan_.driven_pins.begin();
        for (int i = 0; i < plan_.cloth.points(); ++i)
            if (driven != plan_.driven_pins.end() && driven->point == i) ++driven;
            else if (plan_.cloth.pinned[std::size_t(i)]) held_pins_.push_back(i);
    }

    // Bring the plan's force into the form of the kernel.
    virtual void apply_force() = 0;
    Vec3 applied_at(int point) const { return plan_.field_at(point) - plan_.gravity; }
    // Of rows [begin, end) of a state that is laid out like memory.
    void place_pins(const PinTime& time, int begin, int end, AlignedVector<Real>& state) const {
        plan_.each_driven_pin(time, begin * columns(), end * columns(),
                              [&](int point, const Vec3& place, const Vec3& velocity) {
                                  points_.set(state, point, {place - origin_, velocity});
                              });
    }
    const RealKernels<Real>& kernels() const { return kernels_of<Real>(*plan_.kernels); }
    int rows() const { return plan_.cloth.rows; }
    int columns() const { return plan_.cloth.columns; }
    // Some rows are at the end of a step.
    void watch(int begin, int end) {
        if (planes_.up()) planes_.check([&](int k) { return component(k, begin, end); });
    }

    Plan plan_;
    Layout layout_;
    StatePoints<Real, Layout> points_;
    Vec3 origin_ = Vec3::Zero();  // of the positions in memory [m]
    AlignedVector<Real> memory_;
    // Data of the state that an engine keeps in memory still holds; false after every change from
    // elsewhere.
    bool state_known_ = false;
    ContactPass<Real, Layout> contact_pass_;
    SeparatingPlanes<Real> planes_;

private:
    void respond(double t0, double t1, double dt, int threads) {
        const double rounding = std::max(std::exchange(rounding_of_arrays, 0.0),
                                         double(std::numeric_limits<Real>::epsilon()));
        const ContactReport report = contact_pass_.respond(memory_, t0, t1, dt, rounding, threads);
        contact_responses += report.responses;
        contact_report.note(report);
        if (report.changed) {  // also by a step that finds no place
            state_known_ = false;
            watched.first_contact = std::min(watched.first_contact, t1);
        }
        watched.point_depth = std::max(watched.point_depth, report.depth);
        watched.lift_work += report.lift_work;
    }
    // Of a cloth in one strip.
    ComponentRows<Real> component(int k, int begin, int end) const {
        const VectorGeometry g = layout_.geometry(kernels().lanes);
        return {memory_.data() + layout_.first() + begin * g.row + k * g.component, g.row, g.vector,
                end - begin, g.vectors};
    }

    // By another one, not by what a step or a contact makes of it.
    void state_replaced() {
        state_known_ = false;
        contact_pass_.forget(true);
        planes_.drop();
    }
    void stop_held_pins() {
        for (const int point : held_pins_) points_.set_velocity(memory_, point, Vec3::Zero());
    }
    // 0 where it is not finite.
    Vec3 mean_velocity() const {
        Vec3 sum = Vec3::Zero();
        for (int i = 0; i < plan_.cloth.points(); ++i)
            for (int k = 0; k < 3; ++k) sum[k] += memory_[points_.place(i, k + 3)];
        return sum.allFinite() ? Vec3(sum / plan_.cloth.points()) : Vec3(Vec3::Zero());
    }
    // Whether the state is; padding is.
    bool finite() const {
        const Blocks all = layout_.state_blocks();
        std::atomic<bool> is{true};
        in_parts(all.count, int(std::min<std::ptrdiff_t>(parts(), all.count)),
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                     const Real* const first =
                         memory_.data() + layout_.first() + begin * all.stride;
                     if (!kernels().all_finite(first, Blocks{end - begin, all.size, all.stride}))
                         is = false;
                 });
        return is;
    }
    // Threads for copies: the team of the steps, in whose caches the state is, or one. Of another
    // team some would end.
    int parts() const {
        constexpr std::int64_t least_points_per_thread = 2'000;  // half or twice: not measured
        const int team = RowBand::team(rows(), threads);
        return plan_.cloth.points() >= least_points_per_thread * team ? team : 1;
    }
    // `visit(place)` in the order of SavedState::values.
    template <class Visit>
    void each_value(Visit visit) const {
        for (int part = 0; part < (compensated ? 4 : 2); ++part)
            for (int i = 0; i < plan_.cloth.points(); ++i)
                for (int k = 0; k < 3; ++k)
                    visit(points_.place(i, part % 2 * 3 + k) +
                          (part < 2 ? 0 : layout_.compensation()));
    }

    template <class In>
    bool load_any(const In* x, const In* v) {
        set_origin(compensated ? far_origin(x) : Vec3(Vec3::Zero()));
        state_replaced();
        in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
            for (int r = int(begin); r < int(end); ++r) {
                put_row(x + std::ptrdiff_t(r) * 3 * columns(), r, 0, origin_);
                put_row(v + std::ptrdiff_t(r) * 3 * columns(), r, 3, Vec3::Zero());
            }
        });
        stop_held_pins();
        return finite();
    }
    template <class Out>
    void store_any(Out* x, Out* v) const {
        in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
            for (int r = int(begin); r < int(end); ++r) {
                if (x) take_row(r, 0, origin_, x + std::ptrdiff_t(r) * 3 * columns());
                if (v) take_row(r, 3, Vec3::Zero(), v + std::ptrdiff_t(r) * 3 * columns());
            }
        });
    }
    // Three components of a row, from the first on, relative to `origin`. A difference keeps the
    // sign of a zero.
    template <class In>
    void put_row(const In* from, int r, int first, const Vec3& origin) {
        const std::ptrdiff_t size = layout_.component(), low = layout_.compensation();
        Real* const row = memory_.data() + layout_.at(r, 0, first);
        for (int c = 0; c < columns(); ++c, from += 3) {
            Real* const to = row + layout_.in_row(c);
            for (int k = 0; k < 3; ++k) {
                if constexpr (compensated) {
                    const double value = double(from[k]) - origin[k];
                    to[k * size] = Real(value);
                    to[k * size + low] = Real(value - double(to[k * size]));
                } else {
                    to[k * size] = Real(from[k]);
                }
            }
        }
    }
    template <class Out>
    void take_row(int r, int first, const Vec3& origin, Out* to) const {
        const std::ptrdiff_t size = layout_.component(), low = layout_.compensation();
        const Real* const row = memory_.data() + layout_.at(r, 0, first);
        const Vec3 back = Vec3::Zero() - origin;
        for (int c = 0; c < columns(); ++c, to += 3) {
            const Real* const from = row + layout_.in_row(c);
            for (int k = 0; k < 3; ++k) {
                if constexpr (compensated)
                    to[k] = Out(double(from[k * size]) + double(from[k * size + low]) - back[k]);
                else to[k] = Out(from[k * size]);
            }
        }
    }

    // float32 resolves points of a cloth far from 0 no better than by 6e-8 of that distance. So in
    // single memory holds positions relative to an origin, 0 unless the cloth is far off for its
    // size.
    template <class In>
    Vec3 far_origin(const In* x) const {
        // What is no number does not count.
        Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
        for (int i = 0; i < plan_.cloth.points(); ++i)
            for (int k = 0; k < 3; ++k) {
                const double value = double(x[3 * std::ptrdiff_t(i) + k]);
                low[k] = value < low[k] ? value : low[k];
                high[k] = value > high[k] ? value : high[k];
            }
        const Vec3 middle = low / 2 + high / 2;
        const bool far = middle.norm() > extents_that_are_far * (high - low).norm();
        return far && middle.norm() < double(std::numeric_limits<float>::max())
            ? middle
            : Vec3(Vec3::Zero());
    }
    void set_origin(const Vec3& origin) {
        origin_ = origin;
        for (Sphere& sphere : plan_.spheres) sphere.origin = origin;
    }

    std::vector<int> held_pins_;
    AlignedVector<Real> checkpoint_;
    Tally tally_at_checkpoint_;
};

}  // namespace clothsim
