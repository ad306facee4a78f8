// The contact pass after a step of any integrator. "reflect" and "ray" look at the state at the end of the
// step, sphere after sphere. Then "continuous" also sees the state at its start.
//
//      start of step      free end                        response
//
//           o - - - - - - -> x                 o - - -t    t: time of impact, on the contact radius
//                       ____                         / \   n: normal there
//                     /  S   \                      s    n   v.n -> -e v.n, friction on the rest
//                                                            s: the rest of the step, along the new velocity
//
//   1. A kernel finds the vectors of points that may touch, responds where it can and copies the others.
//      Points do not depend on each other here, so any number of threads gives the same bits.
//   2. Bounces and points near several spheres follow, point by point in the cloth's order.
//      The energy of a bounce depends on the neighbours as they are now.
//
//     all points -> open vectors (kernel) -> done | free: untouched | unresolved -> exact::respond, one by
//     one
//
// Where a sphere has the offset "cell", each point has a contact radius of its own: contact/cell_pass.hpp.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>

#include "contact/cell_pass.hpp"
#include "contact/contact_report.hpp"
#include "contact/exact.hpp"
#include "contact/large_cells.hpp"
#include "contact/offset.hpp"
#include "contact/state_points.hpp"
#include "kernels/contact/contact_kernels.hpp"
#include "kernels/kernel_table.hpp"
#include "measure/diagnostics.hpp"
#include "measure/impulses.hpp"
#include "memory/aligned_vector.hpp"
#include "memory/threads.hpp"
#include "memory/plan.hpp"

namespace clothsim {

template <class Real, class Layout>
class ContactPass {
public:
    ContactPass(const Plan& plan, const Layout& layout, Impulses& impulses)
        : plan_(plan),
          layout_(layout),
          points_(layout_, plan.cloth.columns),
          impulses_(impulses),
          kernel_(plan.kernels->contact.of<Real>(plan.kernel == Kernel::gather)),
          inside_kernel_(plan.kernels->contact.inside<Real>()) {
        bool cells = false;
        for (const Sphere& sphere : plan.spheres)
            if (sphere.response == Response::continuous) {
                spheres_.push_back(&sphere);
                numbers_.push_back(std::size_t(&sphere - plan.spheres.data()));
                cells |= sphere.cells;
                bounces_ |= sphere.restitution > 0;
            }
        if (plan.spheres.empty()) return;
        diagonal_ = std::hypot(plan.cloth.row_spacing, plan.cloth.column_spacing);
        const int lanes = kernels_of<Real>(*plan.kernels).lanes;
        geometry_ = layout.geometry(lanes);
        const std::size_t vectors = std::size_t(geometry_.rows) * std::size_t(geometry_.vectors);
        open_.assign(vectors, 0);
        unresolved_.assign(vectors, 0);
        free_.assign(vectors, 0);
        mass_.assign(vectors * std::size_t(lanes), Real(0));
        for (int r = 0; r < geometry_.rows; ++r)
            for (int j = 0; j < geometry_.vectors; ++j)
                for (int l = 0; l < lanes; ++l) {
                    const int column = layout.column(j, l, lanes);
                    if (column >= plan.cloth.columns) continue;
                    const std::size_t point = std::size_t(r * plan.cloth.columns + column);
                    free_[index(r, j)] |= std::uint64_t(!plan.cloth.pinned[point]) << l;
                    mass_[index(r, j) * std::size_t(lanes) + std::size_t(l)] = Real(plan.cloth.mass[point]);
                }
        lanes_ = lanes;
        touched_.assign(std::size_t(geometry_.rows), false);
        if (cells)
            cell_pass_.emplace(plan.cloth, layout, geometry_, lanes, plan.kernels->contact,
                               plan.kernel == Kernel::gather);
    }
    ContactPass(const ContactPass&) = delete;

    void forget() {
        current_ = false;
        if (cell_pass_) cell_pass_->forget();
    }

    // Before a step: the state it starts from.
    void keep(const AlignedVector<Real>& memory) {
        if (!current_ && !spheres_.empty()) before_ = memory;
    }

    // `rounding`: relative, of the state.
    ContactReport respond(AlignedVector<Real>& memory, double t0, double t1, double dt, double rounding,
                          int threads) {
        memory_ = &memory;
        report_ = {};
        std::fill(touched_.begin(), touched_.end(), false);
        for (const Sphere& sphere : plan_.spheres)
            if (sphere.response != Response::continuous) respond_at_end(sphere, t1, dt, threads);
        if (spheres_.empty()) return report_;
        swept_.clear();
        for (const Sphere* sphere : spheres_) {
            const double band = band_of_cells(sphere->contact_radius, diagonal_, sizeof(Real) == 4);
            swept_.push_back(swept(*sphere, t0, t1, dt, rounding, band));
        }
        current_ = true;
        if (cell_pass_) respond_to_cells(threads);
        else respond_to_points(threads);
        return report_;
    }

    // Whether the pass has inspected a mass point of the row: any other is outside the spheres.
    bool touched(int row) const {
        const auto first = open_.begin() + std::ptrdiff_t(index(row, 0));
        return touched_[std::size_t(row)] ||
            std::any_of(first, first + geometry_.vectors, [](std::uint8_t open) { return open != 0; });
    }

    // Energies that contact/exact.hpp needs.
    PointState before(int i) const { return points_.get(before_, i); }
    PointState now(int i) const { return points_.get(*memory_, i); }
    void set(int i, const PointState& state) { points_.set(*memory_, i, state); }
    // A radius that grows moves points and gives no velocity.
    void give(int i, const SweptSphere& s, const Vec3& change) {
        if (raising_) return;
        impulses_.give(numbers_[std::size_t(&s - swept_.data())], i / plan_.cloth.columns,
                       i % plan_.cloth.columns, mass(i) * change);
    }
    bool pinned(int i) const { return plan_.cloth.pinned[std::size_t(i)]; }
    double mass(int i) const { return plan_.cloth.mass[std::size_t(i)]; }
    Vec3 field_at(int i) const { return plan_.field_at(i); }
    double spring_energy(int i, const Vec3& x) const {
        return clothsim::spring_energy(plan_.cloth, i, x, [this](int j) { return position(j); });
    }
    Surface<double> cell_surface_at(int i, const SweptSphere& s) const {
        const Surface<double> before = cell_surface<Real>(s, cell_pass_->radius2_before(i));
        if (!raising_) return before;
        Surface<double> surface = cell_surface<Real>(s, largest_radius2(i));
        surface.innermost = before.innermost;
        return surface;
    }
    Vec3 position(int i) const { return points_.position(*memory_, i); }

private:
    using Points = StatePoints<Real, Layout>;
    // Rounds in which points are moved outwards as rho grows. Each leaves at most 0.71 of the last, so that
    // twice as many change nothing; half leave 3e-8 of the first move.
    static constexpr int most_raises = 100;
    // Below this number of points a second thread costs more than it saves.
    static constexpr int least_points_per_thread = 8192;

    std::size_t index(int row, int vector) const {
        return std::size_t(row) * std::size_t(geometry_.vectors) + std::size_t(vector);
    }

    // "reflect" and "ray", which see the end of the step alone.
    void respond_at_end(const Sphere& sphere, double t, double dt, int threads) {
        struct Ends {
            ContactPass* pass;
            Contact contact;
            std::atomic<std::int64_t> responses{0};
            std::atomic<bool> changed{false};
        } ends{this, Contact(sphere, t, 2 * double(Real(dt / 2)))};  // as the shader has it
        Real center[3];
        for (int k = 0; k < 3; ++k) center[k] = Real(ends.contact.center[k]);
        constexpr double margin = outer_epsilons * double(std::numeric_limits<Real>::epsilon());
        const Real radius2 = Real(sphere.contact_radius * sphere.contact_radius * (1 + margin));
        ContactArguments<Real> a{};
        a.geometry = geometry_;
        a.state = memory_->data() + layout_.first();
        a.context = &ends;
        a.unresolved = [](void* context, int row, int vector, std::uint64_t lanes) {
            Ends& all = *static_cast<Ends*>(context);
            for (; lanes != 0; lanes &= lanes - 1) {
                const int column = all.pass->layout_.column(vector, __builtin_ctzll(lanes), all.pass->lanes_);
                if (column >= all.pass->plan_.cloth.columns) continue;
                all.pass->touched_[std::size_t(row)] = true;
                const int point = row * all.pass->plan_.cloth.columns + column;
                if (all.pass->pinned(point) || !touches(all.contact, all.pass->position(point))) continue;
                ++all.responses;
                if (all.pass->respond_at_end(all.contact, point)) all.changed = true;
            }
        };
        each_part(threads, [&](int begin, int end) { inside_kernel_(a, center, radius2, begin, end); });
        report_.responses += ends.responses;
        report_.changed |= ends.changed;
    }
    bool respond_at_end(const Contact& contact, int i) {
        const PointState before = now(i), after = clothsim::respond(contact, before);
        impulses_.give(std::size_t(&contact.sphere - plan_.spheres.data()), i / plan_.cloth.columns,
                       i % plan_.cloth.columns, mass(i) * (after.velocity - before.velocity));
        set(i, after);
        return after.position != before.position || after.velocity != before.velocity;
    }

    void respond_to_points(int threads) {
        find(threads);
        for (int r = 0; r < geometry_.rows; ++r)
            for (int j = 0; j < geometry_.vectors; ++j) {
                report_.changed |= (open_[index(r, j)] & vector_responded) != 0;
                finish_vector(r, j);
                if (open_[index(r, j)] & vector_unresolved) copy(r, j);
            }
    }
    ContactArguments<Real> arguments() {
        ContactArguments<Real> a{};
        a.geometry = geometry_;
        a.state = memory_->data() + layout_.first();
        a.before = before_.data() + layout_.first();
        a.free = free_.data();
        a.open = open_.data();
        a.spheres = swept_.data();
        a.sphere_count = int(swept_.size());
        a.bounces = bounces_;
        a.mass = mass_.data();
        a.impulses = impulses_.of_row(numbers_[0], 0);
        a.impulse_row = std::ptrdiff_t(impulses_.size_of_row());
        a.unresolved = [](void* context, int row, int vector, std::uint64_t lanes) {
            auto* const pass = static_cast<ContactPass*>(context);
            pass->unresolved_[pass->index(row, vector)] |= lanes;
        };
        a.context = this;
        return a;
    }
    int team_of(int threads) const {
        return std::max(1, std::min(threads, plan_.cloth.points() / least_points_per_thread));
    }
    // `work(begin, end)` for all rows in parts.
    template <class Work>
    void each_part(int threads, const Work& work) const {
        in_parts(geometry_.rows, team_of(threads),
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end, int) { work(int(begin), int(end)); });
    }
    void find(int threads) {
        const ContactArguments<Real> a = arguments();
        each_part(threads, [&](int begin, int end) { kernel_(a, begin, end); });
    }

    void respond_to_cells(int threads) {
        const auto each = [&](const auto& work) { each_part(threads, work); };
        raising_ = false;
        const bool several = swept_.size() > 1,
                   near = cell_pass_->respond(arguments(), each, team_of(threads) == 1);
        if (near || !several) finish_cells(each);
        if (several) before_ = *memory_;
        report_.note_capped(large_cells_.pierced(plan_.cloth, swept_, [this](int i) { return position(i); }));
    }
    template <class Each>
    void finish_cells(const Each& each) {
        const std::uint8_t all = cell_pass_->marks();
        report_.changed |= (all & CellMarks::responded) != 0;
        if (all & CellMarks::unresolved)
            for (int r = 0; r < geometry_.rows; ++r)
                for (int j = 0; j < geometry_.vectors && (cell_pass_->marks(r) & CellMarks::unresolved); ++j)
                    finish_vector(r, j);
        raising_ = true;
        bool raised = true;
        for (int round = 0; round < most_raises && raised; ++round) {
            if (swept_.size() > 1) {
                cell_pass_->find_radii(each);
                raised = raise_among_several();
            } else {
                raised = cell_pass_->raise(each);
            }
            report_.changed |= raised;
        }
        note_capped();
    }
    // `visit(i)` for the mass points near a sphere that may move.
    template <class Visit>
    void each_near_point(const Visit& visit) const {
        for (int r = 0; r < geometry_.rows; ++r)
            for (int j = 0; j < geometry_.vectors && cell_pass_->marks(r); ++j) {
                std::uint64_t lanes = cell_pass_->near_lanes(index(r, j)) & free_[index(r, j)];
                for (; lanes != 0; lanes &= lanes - 1)
                    visit(r * plan_.cloth.columns + layout_.column(j, __builtin_ctzll(lanes), lanes_));
            }
    }
    // The places alone of points that lie too deep for the cells as they are now.
    bool raise_among_several() {
        bool raised = false;
        each_near_point([&](int i) {
            if (!low(i)) return;
            PointState end = now(i);
            const Vec3 velocity = end.velocity, start = before(i).position, free_end = end.position;
            if (!exact::resolve(*this, i, swept_, start, end)) report_.note_trapped(i);
            if (end.position == free_end) return;
            raised = true;
            set(i, {end.position, velocity});
        });
        return raised;
    }
    // rho^2 of a near point within the step: rho is convex in the corners.
    double largest_radius2(int i) const {
        return std::max(cell_pass_->radius2_before(i), cell_pass_->radius2_now(i));
    }
    // Whether a point lies too deep in a sphere.
    bool low(int i) const {
        const double radius2 = largest_radius2(i);
        return std::any_of(swept_.begin(), swept_.end(), [&](const SweptSphere& s) {
            const double least2 = s.cells ? least_distance2<Real>(s, radius2) : s.surface * s.surface;
            return (position(i) - exact::vec(s.end)).squaredNorm() < least2 * (1 + 1e-12);
        });
    }
    void note_capped() {
        if (swept_.size() == 1 && !(cell_pass_->marks() & CellMarks::capped)) return;
        each_near_point([&](int i) {
            const double radius2 = cell_pass_->radius2_now(i);
            for (const SweptSphere& s : swept_)
                if (s.cells && radius2 > s.surface * s.surface &&
                    (position(i) - exact::vec(s.end)).norm() < s.reach)
                    report_.note_capped(i);
        });
    }

    void finish_vector(int row, int vector) {
        std::uint64_t& lanes = unresolved_[index(row, vector)];
        for (; lanes != 0; lanes &= lanes - 1) {
            const int column = layout_.column(vector, __builtin_ctzll(lanes), lanes_);
            if (column >= plan_.cloth.columns) continue;
            const int i = row * plan_.cloth.columns + column;
            if (pinned(i)) {
                note_if_inside(i);
                continue;
            }
            const PointState free_end = now(i);
            if (!exact::resolve(*this, i, swept_)) report_.note_trapped(i);
            const PointState end = now(i);
            report_.changed |= end.position != free_end.position || end.velocity != free_end.velocity;
        }
    }

    void note_if_inside(int i) {
        for (const SweptSphere& s : swept_)
            if ((position(i) - exact::vec(s.end)).norm() <
                (s.cells ? cell_surface_at(i, s).lowest : s.radius))
                report_.note_pinned(i);
    }

    void copy(int row, int vector) {
        const std::ptrdiff_t at = layout_.first() + row * geometry_.row + vector * geometry_.vector;
        for (int part = 0; part < (Points::compensated ? 2 : 1); ++part)
            for (int k = 0; k < 6; ++k) {
                const std::ptrdiff_t from = at + k * geometry_.component + part * geometry_.compensation;
                std::copy_n(memory_->data() + from, lanes_, before_.data() + from);
            }
    }

    const Plan& plan_;
    Layout layout_;
    Points points_;
    Impulses& impulses_;
    ContactKernel<Real> kernel_;
    InsideKernel<Real> inside_kernel_;
    std::vector<const Sphere*> spheres_;
    std::vector<std::size_t> numbers_;  // among all spheres
    double diagonal_ = 0;  // of a cell at rest [m]
    bool bounces_ = false;
    VectorGeometry geometry_{};
    int lanes_ = 0;
    AlignedVector<Real> before_;
    bool current_ = false;  // whether `before_` is the state
    AlignedVector<Real>* memory_ = nullptr;
    std::vector<std::uint8_t> open_;
    std::vector<std::uint8_t> touched_;  // rows in which a point was inside at the end of the step
    std::vector<std::uint64_t> unresolved_, free_;
    std::vector<Real> mass_;  // a lane after the other; 0 of padding
    std::vector<SweptSphere> swept_;
    std::optional<CellPass<Real>> cell_pass_;
    LargeCells large_cells_;
    bool raising_ = false;
    ContactReport report_;
};

}  // namespace clothsim
