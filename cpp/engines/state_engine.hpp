// Common parts of the engines, for any layout: moving the state in and out, inspecting it, and responding to
// contacts.
//
// A Layout says where component k (x, y, z, vx, vy, vz) of the mass point (row, column) lies:
// `at(row, column, k)`; compensation lies `compensation()` elements further.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

#include "contact/contact_pass.hpp"
#include "contact/near_spheres.hpp"
#include "contact/response.hpp"
#include "contact/separating_planes.hpp"
#include "engines/coefficients.hpp"
#include "engines/engine.hpp"
#include "measure/depth.hpp"
#include "memory/aligned_vector.hpp"
#include "memory/caches.hpp"
#include "memory/finite.hpp"
#include "memory/parts.hpp"
#include "memory/row_band.hpp"
#include "memory/row_copies.hpp"

namespace clothsim {

// Padding holds a point that is far from every cloth, finite when squared in single, and never moves.
inline constexpr double far_away = 1e15;

template <class Real, class Layout>
class StateEngine : public Engine {
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
        for (int r = 0; r < rows(); ++r)
            for (int c = 0; c < columns(); ++c)
                for (int k = 0; k < 6; ++k) {
                    const double value = memory_[layout_.at(r, c, k)];
                    const bool good =
                        k < 3 ? std::abs(value) <= largest : std::abs(value - mean[k - 3]) <= limit;
                    if (!good) return std::int64_t(r) * columns() + c;
                }
        return -1;
    }

    void place_pins(double t) final {
        if (!plan_.has_driven_pins()) return;
        place_pins(PinTime::at_rest(t), 0, rows(), memory_);
        state_changed();
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

    SavedState saved_state() const final {
        SavedState state;
        for (const SavedPart& part : saved_parts(compensated))
            for_each_place(part, [&](std::ptrdiff_t at) { (state.*part.values).push_back(memory_[at]); });
        state.origin = origin_;
        state.contact_energy = contact_energy;
        state.contacts = contact_pass_.persistent();
        state.impulses = impulses.sums();
        return state;
    }
    void set_saved_state(const SavedState& state) final {
        for (const SavedPart& part : saved_parts(compensated)) {
            auto next = (state.*part.values).begin();
            for_each_place(part, [&](std::ptrdiff_t at) { memory_[at] = Real(*next++); });
        }
        stop_pinned_points();
        set_origin(state.origin);
        state_replaced();
        contact_energy = state.contact_energy;
        contact_pass_.set_persistent(state.contacts);
        impulses.go_on(state.impulses);
    }

    void save_checkpoint() final {
        checkpoint_.resize(memory_.size());
        in_parts(std::ptrdiff_t(memory_.size()), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end, int) {
            std::copy(memory_.begin() + begin, memory_.begin() + end, checkpoint_.begin() + begin);
        });
        energy_at_checkpoint_ = contact_energy;
        responses_at_checkpoint_ = contact_responses;
        watched_at_checkpoint_ = watched;
        persistent_at_checkpoint_ = contact_pass_.persistent();
        impulses_at_checkpoint_ = impulses;
    }
    void restore_checkpoint() final {
        memory_ = checkpoint_;
        contact_energy = energy_at_checkpoint_;
        contact_responses = responses_at_checkpoint_;
        watched = watched_at_checkpoint_;
        state_replaced();
        contact_pass_.set_persistent(persistent_at_checkpoint_);
        impulses = impulses_at_checkpoint_;
    }
    void note_all_depths(double t) final {
        std::fill(touched_rows_.begin(), touched_rows_.end(), true);
        note_depths(t);
    }
    bool has_continuous() const final { return contact_pass_.needed(); }

protected:
    // 0 where it is not finite.
    Vec3 mean_velocity() const {
        Vec3 sum = Vec3::Zero();
        for (int r = 0; r < rows(); ++r)
            for (int c = 0; c < columns(); ++c)
                for (int k = 0; k < 3; ++k) sum[k] += memory_[layout_.at(r, c, k + 3)];
        return sum.allFinite() ? Vec3(sum / plan_.cloth.points()) : Vec3(Vec3::Zero());
    }

    static constexpr bool compensated = sizeof(Real) == 4;

    StateEngine(const Plan& plan, const Layout& layout, std::ptrdiff_t size)
        : plan_(plan),
          layout_(layout),
          memory_(std::size_t(size), Real(0)),
          contact_pass_(plan_, layout_, impulses),
          planes_(kernels()),
          touched_rows_(std::size_t(plan.cloth.rows), false) {
        impulses = Impulses(plan_);
        for (int i = 0; i < plan_.cloth.points(); ++i)
            if (plan_.cloth.pinned[std::size_t(i)]) pinned_points_.push_back(i);
    }

    // Of rows [begin, end) of a state that is laid out like memory.
    void place_pins(const PinTime& time, int begin, int end, AlignedVector<Real>& state) const {
        plan_.each_driven_pin(time, begin * columns(), end * columns(),
                              [&](int point, const Vec3& place, const Vec3& velocity) {
                                  const Vec3 here = place - origin_;
                                  for (int k = 0; k < 6; ++k)
                                      set_value(layout_.at(point / columns(), point % columns(), k),
                                                k < 3 ? here[k] : velocity[k - 3], state);
                              });
    }
    // Bring the plan's force into the form of the kernel.
    virtual void apply_force() = 0;
    Vec3 applied_at(int point) const { return plan_.field_at(point) - plan_.gravity; }

    std::int64_t clear_steps(const Clock& clock, std::int64_t most) final {
        return planes_.clear_steps(contact_pass_.spheres(), plan_.gravity, clock, most,
                                   [&](int k) { return component(k, 0, rows()); });
    }
    bool advance_behind_planes(std::int64_t steps, const Clock& clock, int threads) final {
        planes_.raise();
        this->advance(steps, clock, threads);
        contact_pass_.forget();
        return planes_.lower();
    }
    // Some rows are at the end of a step, at time t; of a cloth in strips, those of columns [first_column,
    // end_column).
    void watch(int begin, int end, double t, int first_column, int end_column) {
        if (planes_.up()) planes_.check([&](int k) { return component(k, begin, end); });
        // Where continuous contact comes after the step, the state is not yet the one at its end.
        if (depths_watched_ && !plan_.spheres.empty() && (planes_.up() || !has_continuous()))
            note_depths(begin, end, t, first_column, end_column);
    }
    void watch(int begin, int end, double t) { watch(begin, end, t, 0, columns()); }
    void keep_state() final { contact_pass_.keep(memory_); }
    ContactReport respond_to_contacts(double t0, double t1, double dt, int threads, Poll& poll) final {
        state_changed();
        const ContactReport report = contact_pass_.respond(memory_, t0, t1, dt, threads, poll);
        if (depths_watched_)
            for (int r = 0; r < rows(); ++r) touched_rows_[std::size_t(r)] |= contact_pass_.touched(r);
        return report;
    }
    void note_depths(double t) final { note_depths(0, rows(), t, 0, columns()); }
    double total_energy() const final {
        Points x(plan_.cloth.points(), 3), v(plan_.cloth.points(), 3);
        store_any(x.data(), v.data());
        const PointsView xs(x.data(), x.rows(), 3), vs(v.data(), v.rows(), 3);
        return energy(plan_, xs, vs).total();
    }

    void state_changed() { state_known_ = known_finite_ = false; }
    // By another one, not by what a step or a contact makes of it.
    void state_replaced() {
        state_changed();
        contact_pass_.forget();
        planes_.drop();
    }
    // Of a cloth in one strip.
    ComponentRows<Real> component(int k, int begin, int end) const {
        const VectorGeometry g = layout_.geometry(kernels().lanes);
        return {memory_.data() + layout_.first() + begin * g.row + k * g.component, g.row, g.vector,
                end - begin, g.vectors};
    }
    const RealKernels<Real>& kernels() const { return kernels_of<Real>(*plan_.kernels); }
    int rows() const { return plan_.cloth.rows; }
    int columns() const { return plan_.cloth.columns; }
    // Threads for copies: the team of the steps, in whose caches the state is, or one. Of another team some
    // would end.
    int parts() const {
        constexpr std::int64_t least_points_per_thread = 2'000;  // half or twice: not measured
        const int team = track_contact_energy ? 1 : RowBand::team(rows(), threads);
        return plan_.cloth.points() >= least_points_per_thread * team ? team : 1;
    }
    double value(std::ptrdiff_t place) const {
        if constexpr (compensated)
            return double(memory_[place]) + double(memory_[place + layout_.compensation()]);
        else return memory_[place];
    }
    template <class T>
    void set_value(std::ptrdiff_t place, T v, AlignedVector<Real>& state) const {
        state[place] = Real(v);
        if constexpr (compensated) state[place + layout_.compensation()] = Real(v - T(state[place]));
    }
    template <class T>
    void set_value(std::ptrdiff_t place, T v) {
        set_value(place, v, memory_);
    }

    // The spheres at the end of a step; continuous spheres have their own pass.
    void contacts(double t, std::vector<Contact>& result) const {
        result.clear();
        for (const Sphere& sphere : plan_.spheres)
            if (sphere.response != Response::continuous)
                result.emplace_back(sphere, t, 2 * double(Real(step_size / 2)));  // as the shader has it
    }
    std::vector<Contact> contacts(double t) const {
        std::vector<Contact> result;
        contacts(t, result);
        return result;
    }

    // Whether a plane across an axis keeps some rows from the sphere; up and down first, as cloth falls.
    bool apart(const Contact& contact, int begin, int end) const {
        const double reach = NearSpheres<Real>::reach_of_plane(contact);
        for (const int k : {1, 0, 2}) {
            const Extent<Real> extent = kernels().extent(component(k, begin, end));
            if (extent.low >= contact.center[k] + reach || extent.high <= contact.center[k] - reach)
                return true;
        }
        return false;
    }

    PointState point_state(int row, int column) const {
        const auto component = [&](int k) { return value(layout_.at(row, column, k)); };
        return {{component(0), component(1), component(2)}, {component(3), component(4), component(5)}};
    }

    // The response of one point that a kernel's test has found.
    void respond_at(const Contact& contact, int row, int column) {
        if (column >= columns()) return;
        if (depths_watched_)
            std::atomic_ref(touched_rows_[std::size_t(row)]).store(true, std::memory_order_relaxed);
        if (plan_.cloth.pinned[row * columns() + column]) return;
        const PointState before = point_state(row, column);
        if (!touches(contact, before.position)) return;
        const PointState after = respond(contact, before);
        contact_responses.fetch_add(1, std::memory_order_relaxed);
        if (after.position != before.position || after.velocity != before.velocity)
            lower(watched.first_contact, contact.time);
        const double mass = plan_.cloth.mass[row * columns() + column];
        impulses.give(std::size_t(&contact.sphere - plan_.spheres.data()), row, column,
                      mass*(after.velocity - before.velocity));
        const double springs_before = track_contact_energy ? spring_energy(row, column) : 0;
        for (int k = 0; k < 6; ++k)
            set_value(layout_.at(row, column, k), k < 3 ? after.position[k] : after.velocity[k - 3]);
        if (track_contact_energy) {
            contact_energy += spring_energy(row, column) - springs_before +
                mass *
                    ((after.velocity.squaredNorm() - before.velocity.squaredNorm()) / 2 -
                     plan_.field_at(row * columns() + column).dot(after.position - before.position));
        }
    }

    // One point after the other, so that the energy of each move is known.
    void collide_all(double t) {
        for (const Contact& contact : contacts(t))
            for (int r = 0; r < rows(); ++r)
                for (int c = 0; c < columns(); ++c) respond_at(contact, r, c);
        if (depths_watched_ && (planes_.up() || !has_continuous())) note_depths(t);
    }

    Plan plan_;
    Layout layout_;
    AlignedVector<Real> memory_;
    // Data of the state that an engine keeps in memory still holds; false after every change from elsewhere.
    bool state_known_ = false;
    // The newest steps have found the state finite, and have left it as it is.
    bool known_finite_ = false;
    ContactPass<Real, Layout> contact_pass_;
    SeparatingPlanes<Real> planes_;

private:
    RowShift row_shift(const Vec3& shift) const {
        RowShift row;
        for (int k = 0; k < 3; ++k)
            if (shift[k] != 0) row.of[k] = row.of[k + 3] = shift[k];
        return row;
    }
    template <class Outside>
    const RowKernels<Real, Outside>& row_kernels() const {
        return state_row_kernels(plan_.kernels->set).template of<Real, Outside>();
    }

    template <class In>
    bool load_any(const In* x, const In* v) {
        set_origin(compensated ? far_origin(x) : Vec3(Vec3::Zero()));
        state_replaced();
        const RowKernels<Real, In>& kernels = row_kernels<In>();
        const RowShift shift = row_shift(-origin_);
        std::atomic<bool> finite{true};
        in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end, int) {
            bool all = true;
            for (std::ptrdiff_t r = begin; r < end; ++r) {
                all &= layout_.put_row(kernels, x + r * 3 * columns(), shift,
                                       memory_.data() + layout_.at(int(r), 0, 0));
                all &= layout_.put_row(kernels, v + r * 3 * columns(), {},
                                       memory_.data() + layout_.at(int(r), 0, 3));
            }
            if (!all) finite.store(false, std::memory_order_relaxed);
        });
        stop_pinned_points();
        return finite;
    }
    void stop_pinned_points() {
        for (const int point : pinned_points_)
            for (int k = 3; k < 6; ++k) set_value(layout_.at(point / columns(), point % columns(), k), 0.0);
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
        const std::ptrdiff_t bytes = count * std::ptrdiff_t(sizeof(Out));
        const bool large = rows() * bytes > bytes_in_shared_cache;
        in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end, int) {
            AlignedVector<Out> outside(std::size_t(large ? count : 0)),
                part(std::size_t(layout_.in_one_strip() ? 0 : count));
            for (std::ptrdiff_t r = begin; r < end; ++r) {
                Out* const place = to + r * count;
                Out* const out = large ? outside.data() : place;
                layout_.take_row(kernels, memory_.data() + layout_.at(int(r), 0, first), shift, out, part);
                if (large) copy_past_caches(out, place, std::size_t(bytes));
            }
        });
    }
    // Whether the state is; padding is.
    bool finite() const {
        if (known_finite_) return true;
        const Blocks all = layout_.state_blocks();
        std::atomic<bool> is{true};
        in_parts(all.count, int(std::min<std::ptrdiff_t>(parts(), all.count)),
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end, int) {
                     const Real* const first = memory_.data() + layout_.first() + begin * all.stride;
                     if (!all_finite(first, Blocks{end - begin, all.size, all.stride})) is = false;
                 });
        return is;
    }
    template <class Visit>
    void for_each_place(const SavedPart& part, Visit visit) const {
        const std::ptrdiff_t low = part.low ? layout_.compensation() : 0;
        for (int r = 0; r < rows(); ++r)
            for (int c = 0; c < columns(); ++c)
                for (int k = 0; k < 3; ++k) visit(layout_.at(r, c, part.first + k) + low);
    }

    // float32 resolves points of a cloth far from 0 no better than by 6e-8 of that distance. So in single
    // memory holds positions relative to an origin, 0 unless the cloth is far off for its size.
    template <class In>
    Vec3 far_origin(const In* x) const {
        double least[3], most[3];
        row_kernels<In>().extent(x, plan_.cloth.points(), least, most);
        const Vec3 low(least[0], least[1], least[2]), high(most[0], most[1], most[2]);
        const Vec3 middle = low / 2 + high / 2;
        const bool far = middle.norm() > extents_that_are_far * (high - low).norm();
        return far && middle.norm() < double(std::numeric_limits<float>::max()) ? middle : Vec3(Vec3::Zero());
    }
    void set_origin(const Vec3& origin) {
        origin_ = origin;
        for (Sphere& sphere : plan_.spheres) sphere.origin = origin;
    }

    // Of rows in which a sphere has found a mass point since the last pass. No other can have one inside: the
    // test of the responses takes in the contact radius, pinned points too, and nothing moves points after
    // it.
    void note_depths(int begin, int end, double t, int first_column, int end_column) {
        for (int r = begin; r < end; ++r) {
            if (!std::exchange(touched_rows_[std::size_t(r)], false)) continue;
            for (const Sphere& sphere : plan_.spheres) {
                const double nearest =
                    std::sqrt(least_square_of_row(r, sphere.center_at(t), first_column, end_column));
                raise(watched.point_depth, sphere.radius - nearest);
            }
        }
    }
    double least_square_of_row(int row, const Vec3& center, int first_column, int end_column) const {
        const int lanes = kernels().lanes;
        if (layout_.in_one_strip()) {
            const VectorGeometry g = layout_.geometry(lanes);
            return least_square(memory_.data() + layout_.first() + row * g.row, g, lanes, center);
        }
        double least = std::numeric_limits<double>::infinity();
        for (int c = first_column; c < end_column; ++c)
            least = std::min(least, (point_state(row, c).position - center).squaredNorm());
        return least;
    }

    double spring_energy(int row, int column) const {
        return clothsim::spring_energy(
            plan_.cloth, row * columns() + column, point_state(row, column).position,
            [this](int j) { return point_state(j / columns(), j % columns()).position; });
    }

    std::vector<int> pinned_points_;
    AlignedVector<Real> checkpoint_;
    double energy_at_checkpoint_ = 0;
    std::int64_t responses_at_checkpoint_ = 0;
    Watched watched_at_checkpoint_;
    std::vector<FacePass::PersistentContact> persistent_at_checkpoint_;
    Impulses impulses_at_checkpoint_;
    std::vector<std::uint8_t> touched_rows_;  // whether a sphere found a mass point in the row
    Vec3 origin_ = Vec3::Zero();
};

}  // namespace clothsim
