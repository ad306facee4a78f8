// Common parts of the engines, for any layout, on top of the state in memory: the responses of the spheres,
// what is watched, and checkpoints.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>

#include "contact/contact_pass.hpp"
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
    bool has_contacts() const final { return !plan_.spheres.empty(); }

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
        return planes_.clear_steps(plan_.spheres, plan_.gravity, clock, most,
                                   [&](int k) { return component(k, 0, rows()); });
    }
    bool advance_behind_planes(std::int64_t steps, const Clock& clock, int threads) final {
        planes_.raise();
        this->advance(steps, clock, threads);
        contact_pass_.forget();
        return planes_.lower();
    }
    // Some rows are at the end of a step.
    void watch(int begin, int end) {
        if (planes_.up()) planes_.check([&](int k) { return component(k, begin, end); });
    }
    void keep_state() final { contact_pass_.keep(memory_); }
    ContactReport respond_to_contacts(double t0, double t1, double dt, int threads) final {
        const double rounding = std::max(std::exchange(this->rounding_of_arrays, 0.0),
                                         double(std::numeric_limits<Real>::epsilon()));
        const ContactReport report = contact_pass_.respond(memory_, t0, t1, dt, rounding, threads);
        contact_responses += report.responses;
        if (report.changed) state_changed();
        if (depths_watched_)
            for (int r = 0; r < rows(); ++r) touched_rows_[std::size_t(r)] |= contact_pass_.touched(r);
        return report;
    }

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
    ContactPass<Real, Layout> contact_pass_;
    SeparatingPlanes<Real> planes_;

private:
    // Of rows in which the last pass has found a mass point near a sphere. No other can have one inside.
    void note_depths(double t) final {
        for (int r = 0; r < rows(); ++r) {
            if (!std::exchange(touched_rows_[std::size_t(r)], false)) continue;
            for (const Sphere& sphere : plan_.spheres) {
                const VectorGeometry g = layout_.geometry(kernels().lanes);
                const double least = least_square(memory_.data() + layout_.first() + r * g.row, g,
                                                  kernels().lanes, sphere.center_at(t));
                raise(watched.point_depth, sphere.radius - std::sqrt(least));
            }
        }
    }
    AlignedVector<Real> checkpoint_;
    Tally tally_at_checkpoint_;
    std::vector<std::uint8_t> touched_rows_;  // whether a sphere found a mass point in the row
};

}  // namespace clothsim
