// Common parts of the engines, for any layout, on top of the state in memory: the responses of the spheres,
// what is watched, and checkpoints.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>

#include "contact/contact_pass.hpp"
#include "contact/near_spheres.hpp"
#include "contact/response.hpp"
#include "contact/separating_planes.hpp"
#include "engines/state_memory.hpp"
#include "measure/depth.hpp"

namespace clothsim {

template <class Real, class Layout>
class StateEngine : public StateMemory<Real, Layout> {
    using Memory = StateMemory<Real, Layout>;

public:
    using Memory::contact_responses, Memory::impulses, Memory::watched;

    void set_sphere(std::size_t sphere, const Vec3& center, const Motion& motion) final {
        plan_.spheres[sphere].center = center;
        plan_.spheres[sphere].motion = motion;
        planes_.drop();
    }
    void set_force(const double* force) final {
        plan_.force = PointsView(force, plan_.cloth.points(), 3);
        apply_force();
        this->state_known_ = false;
    }

    SavedState saved_state() const final {
        SavedState state;
        this->save_values(state);
        state.impulses = impulses.sums();
        return state;
    }
    void set_saved_state(const SavedState& state) final {
        this->set_values(state);
        impulses.go_on(state.impulses);
    }

    void save_checkpoint() final {
        checkpoint_.resize(memory_.size());
        in_parts(std::ptrdiff_t(memory_.size()), this->parts(),
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end, int) {
                     std::copy(memory_.begin() + begin, memory_.begin() + end, checkpoint_.begin() + begin);
                 });
        tally_at_checkpoint_ = *this;
    }
    void restore_checkpoint() final {
        memory_ = checkpoint_;
        static_cast<Tally&>(*this) = tally_at_checkpoint_;
        state_replaced();
    }
    void note_all_depths(double t) final {
        std::fill(touched_rows_.begin(), touched_rows_.end(), true);
        note_depths(t);
    }
    bool has_continuous() const final { return contact_pass_.needed(); }

protected:
    using Memory::columns, Memory::depths_watched_, Memory::kernels, Memory::layout_, Memory::memory_,
        Memory::plan_, Memory::points_, Memory::rows, Memory::state_changed;

    StateEngine(const Plan& plan, const Layout& layout, std::ptrdiff_t size)
        : Memory(plan, layout, size),
          contact_pass_(plan_, layout_, impulses),
          planes_(kernels()),
          touched_rows_(std::size_t(plan.cloth.rows), false) {
        impulses = Impulses(plan_);
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
    ContactReport respond_to_contacts(double t0, double t1, double dt, int threads) final {
        state_changed();
        const double rounding = std::max(std::exchange(this->rounding_of_arrays, 0.0),
                                         double(std::numeric_limits<Real>::epsilon()));
        const ContactReport report = contact_pass_.respond(memory_, t0, t1, dt, rounding, threads);
        if (depths_watched_)
            for (int r = 0; r < rows(); ++r) touched_rows_[std::size_t(r)] |= contact_pass_.touched(r);
        return report;
    }
    void note_depths(double t) final { note_depths(0, rows(), t, 0, columns()); }

    void state_replaced() final {
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
    // The spheres at the end of a step; continuous spheres have their own pass.
    void contacts(double t, std::vector<Contact>& result) const {
        result.clear();
        for (const Sphere& sphere : plan_.spheres)
            if (sphere.response != Response::continuous)
                result.emplace_back(sphere, t,
                                    2 * double(Real(this->step_size / 2)));  // as the shader has it
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

    // The response of one point that a kernel's test has found.
    void respond_at(const Contact& contact, int row, int column) {
        if (column >= columns()) return;
        if (depths_watched_)
            std::atomic_ref(touched_rows_[std::size_t(row)]).store(true, std::memory_order_relaxed);
        const int point = row * columns() + column;
        if (plan_.cloth.pinned[point]) return;
        const PointState before = points_.get(memory_, point);
        if (!touches(contact, before.position)) return;
        const PointState after = respond(contact, before);
        contact_responses.fetch_add(1, std::memory_order_relaxed);
        if (after.position != before.position || after.velocity != before.velocity)
            lower(watched.first_contact, contact.time);
        const double mass = plan_.cloth.mass[point];
        impulses.give(std::size_t(&contact.sphere - plan_.spheres.data()), row, column,
                      mass*(after.velocity - before.velocity));
        points_.set(memory_, point, after);
    }

    ContactPass<Real, Layout> contact_pass_;
    SeparatingPlanes<Real> planes_;

private:
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
            least = std::min(least, (points_.position(memory_, row * columns() + c) - center).squaredNorm());
        return least;
    }

    AlignedVector<Real> checkpoint_;
    Tally tally_at_checkpoint_;
    std::vector<std::uint8_t> touched_rows_;  // whether a sphere found a mass point in the row
};

}  // namespace clothsim
