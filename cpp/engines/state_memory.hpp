// The state of an engine in its layout: into it from arrays of points, out of it, inspected, and relative to
// which origin.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <type_traits>

#include "contact/state_points.hpp"
#include "engines/coefficients.hpp"
#include "engines/engine.hpp"
#include "memory/aligned_vector.hpp"
#include "memory/row_band.hpp"
#include "memory/threads.hpp"

namespace clothsim {

// Padding holds a point that is far from every cloth, finite when squared in single, and never moves.
inline constexpr double far_away = 1e15;

template <class Real, class Layout>
class StateMemory : public Engine {
public:
    bool load(const float* x, const float* v) final { return load_any(x, v); }
    bool load(const double* x, const double* v) final { return load_any(x, v); }
    void store(float* x, float* v) const final { store_any(x, v); }
    void store(double* x, double* v) const final { store_any(x, v); }

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
                if (k < 3 || pin ? std::abs(value) <= largest : std::abs(value - mean[k - 3]) <= limit)
                    continue;
                if (!pin) return i;
                bad_pin = i;
            }
        }
        return bad_pin;
    }

    void place_pins(double t) final {
        if (!plan_.has_driven_pins()) return;
        place_pins(PinTime::at_rest(t), 0, rows(), memory_);
        state_changed();
    }

protected:
    static constexpr bool compensated = sizeof(Real) == 4;

    StateMemory(const Plan& plan, const Layout& layout, std::ptrdiff_t size)
        : plan_(plan),
          layout_(layout),
          points_(layout_, plan.cloth.columns),
          memory_(std::size_t(size), Real(0)) {
        auto driven = plan_.driven_pins.begin();
        for (int i = 0; i < plan_.cloth.points(); ++i)
            if (driven != plan_.driven_pins.end() && driven->point == i) ++driven;
            else if (plan_.cloth.pinned[std::size_t(i)]) held_pins_.push_back(i);
    }

    // Of rows [begin, end) of a state that is laid out like memory.
    void place_pins(const PinTime& time, int begin, int end, AlignedVector<Real>& state) const {
        plan_.each_driven_pin(time, begin * columns(), end * columns(),
                              [&](int point, const Vec3& place, const Vec3& velocity) {
                                  points_.set(state, point, {place - origin_, velocity});
                              });
    }
    void state_changed() { state_known_ = known_finite_ = false; }
    // By another one, not by what a step or a contact makes of it.
    virtual void state_replaced() = 0;
    const RealKernels<Real>& kernels() const { return kernels_of<Real>(*plan_.kernels); }
    int rows() const { return plan_.cloth.rows; }
    int columns() const { return plan_.cloth.columns; }
    // Threads for copies: the team of the steps, in whose caches the state is, or one. Of another team some
    // would end.
    int parts() const {
        constexpr std::int64_t least_points_per_thread = 2'000;  // half or twice: not measured
        const int team = RowBand::team(rows(), threads);
        return plan_.cloth.points() >= least_points_per_thread * team ? team : 1;
    }
    // The values of the state in its saved form.
    void save_values(SavedState& state) const {
        for (const SavedPart& part : saved_parts(compensated))
            each_place(part, [&](std::ptrdiff_t at) { (state.*part.values).push_back(memory_[at]); });
        state.origin = origin_;
    }
    void set_values(const SavedState& state) {
        for (const SavedPart& part : saved_parts(compensated)) {
            auto next = (state.*part.values).begin();
            each_place(part, [&](std::ptrdiff_t at) { memory_[at] = Real(*next++); });
        }
        stop_held_pins();
        set_origin(state.origin);
        state_replaced();
    }

    Plan plan_;
    Layout layout_;
    StatePoints<Real, Layout> points_;
    Vec3 origin_ = Vec3::Zero();  // of the positions in memory [m]
    AlignedVector<Real> memory_;
    // Data of the state that an engine keeps in memory still holds; false after every change from elsewhere.
    bool state_known_ = false;
    // The newest steps have found the state finite, and have left it as it is.
    bool known_finite_ = false;

private:
    // 0 where it is not finite.
    Vec3 mean_velocity() const {
        Vec3 sum = Vec3::Zero();
        for (int i = 0; i < plan_.cloth.points(); ++i)
            for (int k = 0; k < 3; ++k) sum[k] += memory_[points_.place(i, k + 3)];
        return sum.allFinite() ? Vec3(sum / plan_.cloth.points()) : Vec3(Vec3::Zero());
    }

    RowShift row_shift(const Vec3& shift) const {
        RowShift row;
        for (int k = 0; k < 3; ++k)
            if (shift[k] != 0) row.of[k] = row.of[k + 3] = shift[k];
        return row;
    }
    template <class Outside>
    const RowKernels<Real, Outside>& row_kernels() const {
        return kernels().state_rows.template of<Outside>();
    }

    template <class In>
    bool load_any(const In* x, const In* v) {
        set_origin(compensated ? far_origin(x) : Vec3(Vec3::Zero()));
        state_replaced();
        const RowKernels<Real, In>& kernels = row_kernels<In>();
        const RowShift shift = row_shift(-origin_);
        std::atomic<bool> finite{true};
        in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
            bool all = true;
            for (std::ptrdiff_t r = begin; r < end; ++r) {
                all &= layout_.put_row(kernels, x + r * 3 * columns(), shift,
                                       memory_.data() + layout_.at(int(r), 0, 0));
                all &= layout_.put_row(kernels, v + r * 3 * columns(), {},
                                       memory_.data() + layout_.at(int(r), 0, 3));
            }
            if (!all) finite.store(false, std::memory_order_relaxed);
        });
        stop_held_pins();
        return finite;
    }
    void stop_held_pins() {
        for (const int point : held_pins_) points_.set_velocity(memory_, point, Vec3::Zero());
    }
    template <class Out>
    void store_any(Out* x, Out* v) const {
        if (x) store_part(0, origin_, x);
        if (v) store_part(3, Vec3::Zero(), v);
    }
    // Three components of all points, from the first on.
    template <class Out>
    void store_part(int first, const Vec3& origin, Out* to) const {
        const RowKernels<Real, Out>& kernels = row_kernels<Out>();
        const RowShift shift = row_shift(origin);
        const int count = 3 * columns();
        in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
            AlignedVector<Out> part(std::size_t(layout_.in_one_strip() ? 0 : count));
            for (std::ptrdiff_t r = begin; r < end; ++r)
                layout_.take_row(kernels, memory_.data() + layout_.at(int(r), 0, first), shift,
                                 to + r * count, part);
        });
    }
    // Whether the state is; padding is.
    bool finite() const {
        if (known_finite_) return true;
        const Blocks all = layout_.state_blocks();
        std::atomic<bool> is{true};
        in_parts(all.count, int(std::min<std::ptrdiff_t>(parts(), all.count)),
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                     const Real* const first = memory_.data() + layout_.first() + begin * all.stride;
                     if (!kernels().all_finite(first, Blocks{end - begin, all.size, all.stride})) is = false;
                 });
        return is;
    }
    template <class Visit>
    void each_place(const SavedPart& part, Visit visit) const {
        const std::ptrdiff_t low = part.low ? layout_.compensation() : 0;
        for (int i = 0; i < plan_.cloth.points(); ++i)
            for (int k = 0; k < 3; ++k) visit(points_.place(i, part.first + k) + low);
    }

    // float32 resolves points of a cloth far from 0 no better than by 6e-8 of that distance. So in single
    // memory holds positions relative to an origin, 0 unless the cloth is far off for its size.
    template <class In>
    Vec3 far_origin(const In* x) const {
        // Four points at a time: no comparison waits for the last. What is no number does not count.
        constexpr double infinity = std::numeric_limits<double>::infinity();
        double least[12], most[12];
        std::fill_n(least, 12, infinity);
        std::fill_n(most, 12, -infinity);
        const auto note = [&](const In* from, int count) {
            for (int i = 0; i < count; ++i) {
                least[i] = double(from[i]) < least[i] ? double(from[i]) : least[i];
                most[i] = double(from[i]) > most[i] ? double(from[i]) : most[i];
            }
        };
        const std::ptrdiff_t values = 3 * std::ptrdiff_t(plan_.cloth.points());
        std::ptrdiff_t i = 0;
        for (; i + 12 <= values; i += 12) note(x + i, 12);
        note(x + i, int(values - i));
        Vec3 low, high;
        for (int k = 0; k < 3; ++k) {
            low[k] = std::min({least[k], least[k + 3], least[k + 6], least[k + 9]});
            high[k] = std::max({most[k], most[k + 3], most[k + 6], most[k + 9]});
        }
        const Vec3 middle = low / 2 + high / 2;
        const bool far = middle.norm() > extents_that_are_far * (high - low).norm();
        return far && middle.norm() < double(std::numeric_limits<float>::max()) ? middle : Vec3(Vec3::Zero());
    }
    void set_origin(const Vec3& origin) {
        origin_ = origin;
        for (Sphere& sphere : plan_.spheres) sphere.origin = origin;
    }

    std::vector<int> held_pins_;
};

}  // namespace clothsim
