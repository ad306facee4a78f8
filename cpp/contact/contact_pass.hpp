// The contact pass after a step of any integrator. "reflect" and "ray" look at the state at the end
// of the step, sphere after sphere. Then "continuous" also sees the state at its start.
//
//      start of step      free end               response
//
//           o - - - - - - -> x        o - - -t    t: time of impact, on the contact surface
//                       ____                / \   n: normal there
//                     /  S   \             s    n   v.n -> -e v.n, friction on the rest
//                                                   s: the rest of the step, along the new velocity
//
//   1. Kernels find the points that may touch, and respond where a point lies on one sphere. Points
//      do not depend on each other here, so any number of threads gives the same bits.
//   2. The other points follow, one by one in the cloth's order (contact/continuous.hpp), bounces
//      last: their energy depends on the neighbours as they are now.
//
// Where a sphere has the offset "cell", each point has a contact surface of its own, by rho of its
// cells (kernels/contact/contact_impl.hpp):
//
//   1. rho is that before the step; it is computed where the step before has not left it.
//   3. rho of the cells now. Points that lie deeper than it lets them are lifted; again, until none
//      is. A move of d changes rho by at most d and a distance by rho / sqrt(R^2 + rho^2) of that:
//      the rounds contract. Later rounds visit the rows beside points that were lifted.
//
// A phase reads what the phase before has written, or what its own rows wrote before. So any number
// of threads gives the same bits.
#pragma once

#include <algorithm>
#include <atomic>
#include <limits>
#include <utility>
#include <vector>

#include "contact/contact_report.hpp"
#include "contact/continuous.hpp"
#include "contact/large_cells.hpp"
#include "contact/state_points.hpp"
#include "kernels/contact/contact_kernels.hpp"
#include "kernels/kernel_table.hpp"
#include "lanes/aligned_vector.hpp"
#include "measure/diagnostics.hpp"
#include "measure/impulses.hpp"
#include "memory/plan.hpp"
#include "memory/threads.hpp"

namespace clothsim {

template <class Real, class Layout>
class ContactPass {
    using Points = StatePoints<Real, Layout>;

public:
    ContactPass(const Plan& plan, const Layout& layout, Impulses& impulses)
        : plan_(plan),
          layout_(layout),
          points_(layout_, plan.cloth.columns),
          impulses_(impulses),
          kernels_(plan.kernels->contact.of<Real>(plan.kernel == Kernel::gather)),
          lanes_(kernels_of<Real>(*plan.kernels).lanes) {
        if (plan.spheres.empty()) return;
        for (const Sphere& sphere : plan.spheres)
            if (sphere.response == Response::continuous) {
                numbers_.push_back(std::size_t(&sphere - plan.spheres.data()));
                a_.cells |= sphere.cells;
                a_.bounces |= sphere.restitution > 0;
            }
        VectorGeometry& g = a_.geometry = layout.geometry(lanes_);
        const Cloth& cloth = plan.cloth;
        cell_rows_ = std::max(cloth.rows - 1, 1);
        const std::size_t vectors = std::size_t(g.rows) * std::size_t(g.vectors),
                          values = vectors * std::size_t(lanes_);
        for (auto* const sets : {&unresolved_, &inside_, &found_, &free_, &cells_})
            sets->assign(vectors, 0);
        near_.assign(std::max<std::size_t>(numbers_.size(), 1) * vectors, 0);
        mass_.assign(values, Real(0));
        for (int r = 0; r < g.rows; ++r)
            for (int j = 0; j < g.vectors; ++j)
                for (int l = 0; l < lanes_; ++l) {
                    const int column = layout.column(j, l, lanes_);
                    if (column >= cloth.columns) continue;
                    const std::size_t point = std::size_t(r * cloth.columns + column);
                    free_[index(r, j)] |= std::uint64_t(!cloth.pinned[point]) << l;
                    cells_[index(r, j)] |=
                        std::uint64_t(r < cell_rows_ && column < std::max(cloth.columns - 1, 1))
                        << l;
                    mass_[index(r, j) * std::size_t(lanes_) + std::size_t(l)] =
                        Real(cloth.mass[point]);
                }
        for (auto* const rows : {&marks_, &known_, &wanted_}) rows->assign(std::size_t(g.rows), 0);
        lift_work_.assign(std::size_t(g.rows), 0);
        press_.assign(values, Real(0));
        a_.transposed = Layout::is_transposed;
        a_.free = free_.data();
        a_.mass = mass_.data();
        on_spheres_.resize(numbers_.size());
        a_.impulses = on_spheres_.data();
        a_.impulse_row = std::ptrdiff_t(impulses_.size_of_row());
        a_.marks = marks_.data();
        a_.near = near_.data();
        a_.unresolved = unresolved_.data();
        a_.inside = inside_.data();
        a_.press = press_.data();
        a_.wanted = wanted_.data();
        a_.lift_work = lift_work_.data();
        if (!a_.cells) return;
        cell_radii2_.assign(values + std::size_t(lanes_), Real(0));
        point_radii2_.assign(values, Real(0));
        a_.right = cloth.columns > 1 ? layout.right()[0] : 0;
        a_.right_of_last = cloth.columns > 1 ? layout.right()[1] : 0;
        a_.below = cloth.rows > 1 ? g.row : 0;
        a_.cell_lanes = cells_.data();
        a_.cell_radii2 = cell_radii2_.data() + lanes_;
        a_.point_radii2 = point_radii2_.data();
    }
    ContactPass(const ContactPass&) = delete;

    // The state before the next step is not the one after the last. `start`: a call or a scene has
    // brought it.
    void forget(bool start) {
        current_ = false;
        starts_ |= start;
        std::fill(marks_.begin(), marks_.end(), 0);
    }
    // Before a step: the state it starts from.
    void keep(const AlignedVector<Real>& memory) {
        if (!current_ && !numbers_.empty()) before_ = memory;
    }

    // `rounding`: relative, of the state.
    ContactReport respond(AlignedVector<Real>& memory, double t0, double t1, double dt,
                          double rounding, int threads) {
        memory_ = &memory;
        passed_ = true;
        a_.state = memory.data() + layout_.first();
        threads_ = std::max(1, std::min(threads, plan_.cloth.points() / least_points_per_thread));
        report_ = {};
        respond_at_end(t1, dt);
        if (!numbers_.empty()) respond_to_paths(t0, t1, dt, rounding);
        note_depths_at_end(t1);
        starts_ = false;
        return report_;
    }

    // The first point of a cell that is larger than a sphere and touches it at time t, or -1;
    // looked for if the pass has run since the last look.
    std::int64_t large_cell(const AlignedVector<Real>& memory, double t) {
        if (!std::exchange(passed_, false) || !a_.cells) return -1;
        std::fill(wanted_.begin(), wanted_.begin() + cell_rows_, 1);
        kernels_.radii(a_, memory.data() + layout_.first(), 0, a_.geometry.rows);
        if (current_) known(true);
        double least = std::numeric_limits<double>::infinity();
        for (const Sphere& sphere : plan_.spheres)
            if (sphere.cells) least = std::min(least, sphere.radius);
        const Real most = *std::max_element(cell_radii2_.begin() + lanes_, cell_radii2_.end());
        if (!(double(most) > least * least)) return -1;
        return large_cell_at_sphere(plan_.cloth, plan_.spheres, t,
                                    [&](int i) { return points_.position(memory, i); });
    }

    // What contact/continuous.hpp needs.
    PointState before(int i) const { return points_.get(before_, i); }
    PointState now(int i) const { return points_.get(*memory_, i); }
    void set(int i, const PointState& state) {
        report_.changed = true;
        points_.set(*memory_, i, state);
    }
    // A radius that grows moves points and gives no velocity.
    void give(int i, const SweptSphere& s, const Vec3& change) {
        if (!lifting_) impulses_.give(number(s), row(i), column(i), mass(i) * change);
    }
    bool postpones(int i) {
        if (!bouncing_) add(unresolved_, i);
        return !bouncing_;
    }
    void press(int i, double speed) {
        if (a_.cells) press_[std::size_t(value_of(i))] = Real(speed);
    }
    void note_inside(int i, const SweptSphere& s, double depth) {
        if (lifting_) return;
        add(inside_, i);
        if (!starts_) return;
        // Half warns of sheets laid around a sphere by the cells at rest; twice hides another
        // hundredth.
        constexpr double part_of_standoff = 0.01;
        if (s.cells) {
            const double standoff = s.curvature * radius2_before(i) / 2;
            // Cells larger than the sphere have a warning of their own.
            if (depth <= part_of_standoff * standoff || 2 * standoff >= s.most_of_cells) return;
        }
        ContactReport::Start& start = report_.start;
        if (start.points > 0 && start.sphere != std::int64_t(number(s))) return;
        start.sphere = std::int64_t(number(s));
        if (start.points++ == 0 || depth > start.depth) {
            start.depth = depth;
            start.deepest = i;
        }
    }
    double mass(int i) const { return plan_.cloth.mass[std::size_t(i)]; }
    Vec3 field_at(int i) const { return plan_.field_at(i); }
    double spring_energy(int i, const Vec3& x) const {
        return clothsim::spring_energy(plan_.cloth, i, x, [this](int j) { return position(j); });
    }
    exact::Surface surface_at(int i, const SweptSphere& s) const {
        if (!s.cells) return exact::surface_of<Real>(s, 0.0);
        const exact::Surface before = exact::surface_of<Real>(s, radius2_before(i));
        if (!lifting_) return before;
        exact::Surface surface =
            exact::surface_of<Real>(s, std::max(radius2_before(i), radius2_now(i)));
        surface.innermost = before.innermost;
        return surface;
    }

private:
    // Rounds in which points are lifted as rho grows. Each leaves at most 0.71 of the last, so that
    // twice as many change nothing; half leave 3e-8 of the first move.
    static constexpr int most_lifts = 100;
    // Rows that are lifted while they are in the nearest cache.
    static constexpr int rows_at_a_time = 4;
    // Below this number of points a second thread costs more than it saves.
    static constexpr int least_points_per_thread = 8192;

    std::size_t index(int row, int vector) const {
        return std::size_t(row) * std::size_t(a_.geometry.vectors) + std::size_t(vector);
    }
    int row(int i) const { return i / plan_.cloth.columns; }
    int column(int i) const { return i % plan_.cloth.columns; }
    std::size_t number(const SweptSphere& s) const {
        return numbers_[std::size_t(&s - swept_.data())];
    }
    Vec3 position(int i) const { return points_.position(*memory_, i); }
    bool pinned(int i) const { return plan_.cloth.pinned[std::size_t(i)]; }
    // Where a point's own values lie.
    std::ptrdiff_t value_of(int i) const {
        const int vectors = a_.geometry.vectors, c = column(i);
        return std::ptrdiff_t(index(row(i), a_.transposed ? c % vectors : c / lanes_)) * lanes_ +
            (a_.transposed ? c / vectors : c % lanes_);
    }
    void add(std::vector<std::uint64_t>& set, int i) const {
        set[std::size_t(value_of(i) / lanes_)] |= std::uint64_t(1) << value_of(i) % lanes_;
    }
    // `visit(i)` for the points of some lanes of a vector.
    template <class Visit>
    void each_point(int row, int vector, std::uint64_t lanes, const Visit& visit) const {
        for (; lanes != 0; lanes &= lanes - 1) {
            const int column = layout_.column(vector, __builtin_ctzll(lanes), lanes_);
            if (column < plan_.cloth.columns) visit(row * plan_.cloth.columns + column);
        }
    }
    // `visit(row, vector)` for the vectors of marked rows.
    template <class Visit>
    void each_vector(int begin, int end, const Visit& visit) const {
        for (int r = begin; r < end; ++r)
            for (int j = 0; j < a_.geometry.vectors && marks_[std::size_t(r)]; ++j) visit(r, j);
    }
    // `work(begin, end)` for all rows in parts.
    template <class Work>
    void each_part(const Work& work) const {
        in_parts(a_.geometry.rows, threads_,
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end) { work(int(begin), int(end)); });
    }
    bool any(std::uint8_t mark) const {
        std::uint8_t all = 0;
        for (const std::uint8_t row : marks_) all |= row;
        return all & mark;
    }

    // "reflect" and "ray".
    void respond_at_end(double t, double dt) {
        anything_found_ = false;
        for (const Sphere& sphere : plan_.spheres) {
            if (sphere.response == Response::continuous || sphere.penalty()) continue;
            const Contact contact(sphere, t, 2 * double(Real(dt / 2)));  // as the shader has it
            const SweptSphere s = swept(sphere, plan_.cloth, t, t, dt, 0, Points::compensated);
            ContactArguments<Real> a = a_;
            a.before = nullptr;
            a.spheres = &s;
            a.sphere_count = 1;
            std::atomic<std::int64_t> responses{0};
            std::atomic<bool> changed{false};
            each_part([&](int begin, int end) {
                kernels_.find(a, begin, end);
                std::int64_t count = 0;
                bool moved = false;
                each_vector(begin, end, [&](int r, int j) {
                    found_[index(r, j)] |= near_[index(r, j)];
                    each_point(r, j, near_[index(r, j)] & free_[index(r, j)], [&](int i) {
                        if (!touches(contact, position(i))) return;
                        ++count;
                        moved |= respond_at_end(contact, i);
                    });
                });
                responses += count;
                if (moved) changed = true;
            });
            anything_found_ |= any(ContactMarks::near);
            report_.responses += responses;
            report_.changed |= changed;
        }
    }
    bool respond_at_end(const Contact& contact, int i) {
        const PointState before = now(i), after = clothsim::respond(contact, before);
        impulses_.give(std::size_t(&contact.sphere - plan_.spheres.data()), row(i), column(i),
                       mass(i) * (after.velocity - before.velocity));
        points_.set(*memory_, i, after);
        return after != before;
    }
    // Points that "reflect" and "ray" have found, pinned ones too; no other can be inside.
    void note_depths_at_end(double t) {
        if (!anything_found_) return;
        for (const Sphere& sphere : plan_.spheres) {
            if (sphere.penalty()) continue;
            const Vec3 place = sphere.place_at(t);
            for (int r = 0; r < a_.geometry.rows; ++r)
                for (int j = 0; j < a_.geometry.vectors; ++j)
                    each_point(r, j, found_[index(r, j)],
                               [&](int i) { note_depth(-sphere.height(position(i) - place)); });
        }
        std::fill(found_.begin(), found_.end(), 0);
    }
    void note_depth(double depth) { report_.depth = std::max(report_.depth, depth); }

    // "continuous".
    void respond_to_paths(double t0, double t1, double dt, double rounding) {
        swept_.clear();
        for (const std::size_t number : numbers_)
            swept_.push_back(swept(plan_.spheres[number], plan_.cloth, t0, t1, dt, rounding,
                                   Points::compensated));
        a_.before = before_.data() + layout_.first();
        a_.spheres = swept_.data();
        a_.sphere_count = int(swept_.size());
        for (std::size_t s = 0; s < numbers_.size(); ++s)
            on_spheres_[s] = impulses_.of_row(numbers_[s], 0);
        if (!current_) known(false);
        lifting_ = false;
        std::fill(lift_work_.begin(), lift_work_.end(), 0.0);
        each_part([&](int begin, int end) { kernels_.find(a_, begin, end); });
        const bool near = any(ContactMarks::near);
        if (a_.cells && near) {
            want(ContactMarks::near);
            for (std::size_t r = 0; r < known_.size(); ++r) wanted_[r] = wanted_[r] && !known_[r];
            each_part([&](int begin, int end) { kernels_.radii(a_, a_.before, begin, end); });
        }
        if (near) {  // else the marks are those of an earlier step
            each_part([&](int begin, int end) { kernels_.respond(a_, begin, end); });
            report_.changed |= any(ContactMarks::responded);
        }
        for (int pass = 0; pass < 2 && any(ContactMarks::unresolved); ++pass) {
            bouncing_ = pass == 1;
            each_vector(0, a_.geometry.rows, [&](int r, int j) {
                each_point(r, j, std::exchange(unresolved_[index(r, j)], 0),
                           [&](int i) { resolve(i); });
            });
        }
        lift(near);
        for (const double work : lift_work_) report_.lift_work += work / dt;
    }
    void resolve(int i) {
        if (pinned(i)) return note_if_inside(i);
        if (!exact::resolve(*this, i, swept_)) ContactReport::keep_first(report_.trapped, i);
        const std::ptrdiff_t value = value_of(i);
        if (inside_[std::size_t(value / lanes_)] >> value % lanes_ & 1)
            for (const SweptSphere& s : swept_)
                note_depth(-exact::height_of(s, exact::level(s, position(i) - exact::vec(s.end))));
    }
    void note_if_inside(int i) {
        for (const SweptSphere& s : swept_) {
            const double level = exact::level(s, position(i) - exact::vec(s.end));
            note_depth(-exact::height_of(s, level));
            if (level < surface_at(i, s).innermost)
                ContactReport::keep_first(report_.pinned_inside, i);
        }
    }

    // Offset "cell".
    void known(bool all) {
        std::fill(known_.begin(), known_.end(), all);
        if (cell_rows_ < a_.geometry.rows) known_.back() = true;  // no cells
    }
    // The rows of cells beside points of the rows with this mark.
    void want(std::uint8_t mark) {
        for (int r = 0; r < cell_rows_; ++r)
            wanted_[std::size_t(r)] = ((marks_[std::size_t(r)] |
                                        marks_[std::min(std::size_t(r) + 1, marks_.size() - 1)]) &
                                       mark) != 0;
    }
    void lift(bool near) {
        if (a_.cells) {
            want(ContactMarks::near);
            known(false);
            for (std::size_t r = 0; r < known_.size(); ++r) known_[r] |= wanted_[r];
        }
        // Lifts change the cells of rows that are done: their rho is that of the round.
        const bool one_by_one = swept_.size() > 1 || plan_.kernel == Kernel::gather,
                   at_once = threads_ == 1 && !one_by_one;
        lifting_ = a_.first_round = true;
        for (int round = 0; round < most_lifts && (round == 0 || near); ++round) {
            const auto radii = [&](int begin, int end) {
                if (a_.cells && near) kernels_.radii(a_, a_.state, begin, end);
            };
            const auto rows = [&](int begin, int end) { kernels_.lift(a_, begin, end); };
            for (int r = 0; at_once && r < a_.geometry.rows; r += rows_at_a_time) {
                const int end = std::min(r + rows_at_a_time, a_.geometry.rows);
                radii(r, end);
                rows(r, end);
            }
            if (!at_once) each_part(radii);
            if (!at_once) each_part(rows);
            if (one_by_one)
                each_vector(0, a_.geometry.rows, [&](int r, int j) { lift_points(r, j); });
            near = any(ContactMarks::lifted);
            report_.changed |= near;
            a_.first_round = false;
            want(ContactMarks::lifted);
        }
        if (one_by_one) before_ = *memory_;
        current_ = one_by_one || !near;
    }
    // Points that lie too deep in a sphere. Their places alone change.
    void lift_points(int r, int j) {
        each_point(r, j, std::exchange(unresolved_[index(r, j)], 0), [&](int i) {
            PointState end = now(i);
            const Vec3 free_end = end.position;
            if (!exact::resolve(*this, i, swept_, before(i).position, end, false))
                ContactReport::keep_first(report_.trapped, i);
            if (end.position == free_end) return;
            marks_[std::size_t(r)] |= ContactMarks::lifted;
            lift_work_[std::size_t(r)] += mass(i) * double(press_[std::size_t(value_of(i))]) *
                (end.position - free_end).norm();
            points_.set_position(*memory_, i, end.position);
        });
    }
    // rho^2 of a near point before the step, and with the cells as they are now.
    double radius2_before(int i) const { return double(point_radii2_[std::size_t(value_of(i))]); }
    double radius2_now(int i) const {
        double most = 0;
        for (int r = std::max(row(i) - 1, 0); r <= std::min(row(i), cell_rows_ - 1); ++r)
            for (int c = std::max(column(i) - 1, 0);
                 c <= std::min(column(i), std::max(plan_.cloth.columns - 2, 0)); ++c)
                most =
                    std::max(most, double(a_.cell_radii2[value_of(r * plan_.cloth.columns + c)]));
        return most;
    }

    const Plan& plan_;
    Layout layout_;
    Points points_;
    Impulses& impulses_;
    const RowsOfContact<Real>& kernels_;
    int lanes_, cell_rows_ = 1, threads_ = 1;
    std::vector<std::size_t> numbers_;  // of continuous spheres, among all
    std::vector<SweptSphere> swept_;
    std::vector<double*> on_spheres_;  // impulses
    ContactArguments<Real> a_{};
    AlignedVector<Real> before_;
    AlignedVector<Real>* memory_ = nullptr;
    bool current_ = false;  // whether `before_` is the state
    bool starts_ = false, bouncing_ = false, lifting_ = false, anything_found_ = false,
         passed_ = false;
    std::vector<std::uint64_t> near_, unresolved_, inside_, found_, free_, cells_;
    std::vector<std::uint8_t> marks_;  // rows of points
    // Rows of cells: rho is that before the step; is needed.
    std::vector<std::uint8_t> known_, wanted_;
    std::vector<double> lift_work_;
    AlignedVector<Real> cell_radii2_, point_radii2_, press_;
    std::vector<Real> mass_;  // a lane after the other; 0 of padding
    ContactReport report_;
};

}  // namespace clothsim
