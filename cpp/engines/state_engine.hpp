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
#include "measure/watched.hpp"

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
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
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
        for (const Sphere& sphere : plan_.spheres) {
            const Vec3 place = sphere.place_at(t);
            for (int i = 0; i < plan_.cloth.points(); ++i)
                watched.point_depth =
                    std::max(watched.point_depth, -sphere.height(points_.position(memory_, i) - place));
        }
    }
    void note_large_cells(double t) final {
        ContactReport::keep_first(this->contact_report.large_cell, contact_pass_.large_cell(memory_, t));
    }
    bool has_contacts() const final { return !plan_.spheres.empty(); }

protected:
    using Memory::columns, Memory::kernels, Memory::layout_, Memory::memory_, Memory::plan_, Memory::points_,
        Memory::rows, Memory::state_changed;

    StateEngine(const Plan& plan, const Layout& layout, std::ptrdiff_t size)
        : Memory(plan, layout, size), contact_pass_(plan_, layout_, impulses), planes_(kernels()) {
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
        contact_pass_.forget(false);
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
        watched.point_depth = std::max(watched.point_depth, report.depth);
        watched.lift_work += report.lift_work;
        return report;
    }

    void state_replaced() final {
        state_changed();
        contact_pass_.forget(true);
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
    AlignedVector<Real> checkpoint_;
    Tally tally_at_checkpoint_;
};

}  // namespace clothsim
