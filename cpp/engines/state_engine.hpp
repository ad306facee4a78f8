// An engine's state in its layout: into it from arrays of points, out of it, inspected, relative to
// which origin; and the contact pass after its steps.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "engines/coefficients.hpp"
#include "engines/engine.hpp"
#include "lanes/aligned_vector.hpp"
#include "lanes/dot.hpp"
#include "memory/row_band.hpp"
#include "memory/state_points.hpp"
#include "memory/threads.hpp"
#include "responses/paper.hpp"

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
    std::vector<PenaltyArguments<Real>> obstacles;
    PenaltyRows<Real> contacts;
    std::vector<std::uint64_t> near_rows;
};

template <class Real, class Layout>
class StateEngine : public Engine {
public:
    bool load(double t, const float* x, const float* v) final { return load_any(t, x, v); }
    bool load(double t, const double* x, const double* v) final { return load_any(t, x, v); }
    void store(float* x, float* v) const final { store_any(x, v); }
    void store(double* x, double* v) const final { store_any(x, v); }

    SavedState saved_state() const final {
        SavedState state{{}, origin_, impulses.sums(), contacts.sums(), {}};
        for (const Sphere& sphere : plan_.spheres) state.normals.push_back(sphere.normal);
        each_saved_place([&](std::ptrdiff_t at) { state.values.push_back(memory_[at]); });
        return state;
    }
    void set_saved_state(const SavedState& state, double t) final {
        auto next = state.values.begin();
        each_saved_place([&](std::ptrdiff_t at) { memory_[at] = Real(*next++); });
        stop_held_pins();
        origin_ = state.origin;
        if (state.normals.empty()) choose_normals(t);
        else if (compensated)
            for (std::size_t s = 0; s < plan_.spheres.size(); ++s)
                set_normal(plan_.spheres[s], state.normals[s]);
        state_known_ = false;
        impulses.continue_from(state.impulses);
        contacts.continue_from(state.contacts);
    }

    void save_checkpoint() final {
        checkpoint_ = memory_;
        tally_at_checkpoint_ = *this;
    }
    void restore_checkpoint() final {
        memory_ = checkpoint_;
        static_cast<Tally&>(*this) = tally_at_checkpoint_;
        state_known_ = false;
    }

    void advance_and_respond(std::int64_t steps, const Clock& clock, int threads) final {
        if (!has_responses()) return advance(steps, clock, threads);
        Clock now = clock;
        for (std::int64_t k = 0; k < steps; ++k, ++now.steps) {
            advance(1, now, threads);
            respond(now.at(1), now.dt, threads);
        }
    }
    void accept_and_respond(double t0, double t1, int threads) final {
        adaptive()->accept_step(t1);
        if (has_responses()) respond(t1, t1 - t0, threads);
    }

    const Plan& plan() const final { return plan_; }
    void set_sphere(std::size_t sphere, const Vec3& center, const Motion& motion) final {
        plan_.spheres[sphere].center = center;
        plan_.spheres[sphere].motion = motion;
        plan_.spheres[sphere].speed = motion.at(0).velocity.norm();
    }
    void set_force(const double* force) final {
        plan_.force = PointsView(force, plan_.cloth.points(), 3);
        apply_constant_force();
        state_known_ = false;
    }
    void place_pins(double t) final {
        if (!plan_.has_driven_pins()) return;
        place_pins(StageTime::at_rest(t), 0, rows(), memory_);
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
    bool has_responses() const final {
        return std::any_of(plan_.spheres.begin(), plan_.spheres.end(),
                           [](const Sphere& sphere) { return !sphere.penalty(); });
    }
    bool has_penalty() const final { return !penalty_.empty(); }
    std::vector<Work> works_of_forces() const final {
        std::vector<Work> works;
        auto row = work_rows.begin();
        for (const Acting& acting : acting_) {
            works.push_back({acting.force->name, std::accumulate(row, row + rows(), 0.0)});
            row += rows();
        }
        return works;
    }
    std::vector<Depth> depths(double t) const final { return depths_in(memory_, t); }
    int pinned_point_below(double t) const final {
        for (const std::size_t number : penalty_) {
            const Sphere& sphere = plan_.spheres[number];
            const PenaltyContact contact(sphere, StageTime::at_rest(t), origin_);
            for (const int i : pins_)
                if (contact.at(points_.position(memory_, i)).depth > sphere.reach()) return i;
        }
        return -1;
    }
    double speed_bound() const final {
        double squares = 0;
        for (int k = 3; k < 6; ++k) {
            const Extent<Real> extent = kernels().extent(component(k, 0, rows()));
            const double most = std::max(-double(extent.low), double(extent.high));
            squares += most * most;
        }
        return std::sqrt(squares);
    }
    void note_contacts() final {
        for (const std::size_t number : penalty_) {
            const Sphere& sphere = plan_.spheres[number];
            const ContactSums sums = contacts.of(number);
            watched.first_contact = std::min(watched.first_contact, sums.first);
            watched.point_depth =
                std::max(watched.point_depth, sums.deepest - sphere.thickness - sphere.offset);
        }
    }

protected:
    static constexpr bool compensated = sizeof(Real) == 4;

    StateEngine(const Plan& plan, const Layout& layout, std::ptrdiff_t size)
        : plan_(plan),
          layout_(layout),
          points_(layout_, plan.cloth.columns),
          memory_(std::size_t(size), Real(0)),
          responses_(plan_, layout_, impulses = Impulses(plan_)) {
        auto driven = plan_.driven_pins.begin();
        for (int i = 0; i < plan_.cloth.points(); ++i)
            if (plan_.cloth.pinned[std::size_t(i)]) pins_.push_back(i);
        for (int i = 0; i < plan_.cloth.points(); ++i)
            if (driven != plan_.driven_pins.end() && driven->point == i) ++driven;
            else if (plan_.cloth.pinned[std::size_t(i)]) held_pins_.push_back(i);
        for (std::size_t s = 0; s < plan_.spheres.size(); ++s)
            if (plan_.spheres[s].penalty()) penalty_.push_back(s);
        // Bands of the gather kernel may end within a row of groups.
        const bool gather = !Layout::is_transposed;
        const int groups = gather ? (columns() + group_size - 1) / group_size : 1;
        if (!penalty_.empty())
            contacts = ContactTally(plan_.spheres.size(), rows(), groups,
                                    gather ? group_size : kernels().lanes);
        for (const auto& force : plan_.forces)
            if (!force->in_kernels())
                acting_.push_back({force, Points::Zero(plan_.cloth.points(), 3)});
        work_rows.assign(acting_.size() * std::size_t(rows()), 0.0);
        if (acting_.empty()) return;
        acting_x_.resize(plan_.cloth.points(), 3);
        acting_v_.resize(plan_.cloth.points(), 3);
        sum_.resize(plan_.cloth.points(), 3);
        powers_.assign(work_rows.size(), 0.0);
    }

    // Let the forces that the kernels do not compute act on rows [begin, end) of a state that is
    // laid out like memory. Each thread of a team calls it for rows of its own.
    void act(const AlignedVector<Real>& state, const StageTime& time, int begin, int end,
             Barrier& barrier) {
        if (acting_.empty()) return;
        for (int r = begin; r < end; ++r)
            kernels().read_points(state.data() + layout_.at(r, 0), layout_.row_shape(),
                                  origin_.data(), acting_x_.row(r * columns()).data(),
                                  acting_v_.row(r * columns()).data());
        const auto part = [&](Points& points) {
            return points.middleRows(begin * columns(), (end - begin) * columns());
        };
        for (Acting& acting : acting_) part(acting.on_points).setZero();
        barrier.wait();
        const ForceState all{time, acting_x_.data(), acting_v_.data()};
        bool has_whole = false;
        for (Acting& acting : acting_) {
            has_whole |= acting.force->whole();
            if (!acting.force->whole())
                acting.force->act(plan_.cloth, all, begin, end, acting.on_points.data());
            else if (begin == 0) act_at_once(acting, all);
        }
        if (has_whole) barrier.wait();
        apply_forces(begin, end);
        measure_powers(begin, end);
    }
    // Measures the power of each force on the free points of some rows [W], at the velocities of
    // the state on which it acts, by force and row.
    void measure_powers(int begin, int end) {
        for (std::size_t k = 0; k < acting_.size(); ++k)
            for (int r = begin, i = r * columns(); r < end; ++r, i += columns())
                powers_[k * std::size_t(rows()) + std::size_t(r)] =
                    dot(acting_[k].on_points.row(i).data(), acting_v_.row(i).data(), 3 * columns());
    }
    // Calls `visit(place)` for each row [begin, end) in sums by force and row.
    template <class Visit>
    void each_force_sum(int begin, int end, Visit visit) const {
        for (std::size_t k = 0; k < acting_.size(); ++k)
            for (int row = begin; row < end; ++row)
                visit(k * std::size_t(rows()) + std::size_t(row));
    }
    // Let those velocities be the ones in memory.
    void read_acting_velocities(int begin, int end) {
        for (int i = begin * columns(); i < end * columns() && !acting_.empty(); ++i)
            acting_v_.row(i) = points_.velocity(memory_, i);
    }

    // Chooses for a sphere the axis, and the side of it, on which most points of a sample are clear
    // now.
    void choose_sides(double t) {
        for (const std::size_t number : penalty_) {
            Sphere& sphere = plan_.spheres[number];
            if (sphere.flat()) continue;
            const Vec3 center = sphere.center_at(t) - origin_;
            int most = -1;
            for (int side = 0; side < 6; ++side) {
                int clear = 0;
                for (const int row : {0, rows() / 2, rows() - 1})
                    for (const int column : {0, columns() / 2, columns() - 1}) {
                        const Vec3 x = points_.position(memory_, row * columns() + column);
                        const double along = (side < 3 ? 1 : -1) * (x - center)[side % 3];
                        clear += along >= sphere.radius;
                    }
                if (clear > most) clear_side_[number] = side;
                most = std::max(most, clear);
            }
        }
    }
    // Places the obstacles at a time. `unit` is what a force of 1 N is in the sums of the kernel,
    // `factor` that of forces in the impulse [s]; `between_steps`: the state is that of a step.
    void place_obstacles(const StageTime& time, double unit, double factor, bool between_steps,
                         std::vector<PenaltyArguments<Real>>& obstacles) const {
        obstacles.resize(penalty_.size());
        for (std::size_t i = 0; i < penalty_.size(); ++i)
            obstacles[i] = penalty_arguments(plan_.spheres[penalty_[i]], penalty_[i], time, unit,
                                             factor, between_steps);
    }
    static PenaltyRows<Real> penalty_rows(const std::vector<PenaltyArguments<Real>>& obstacles,
                                          ContactTally& sums) {
        return {obstacles.data(),     int(obstacles.size()), sums.data(), sums.row_size(),
                sums.obstacle_size(), sums.lanes(),          nullptr};
    }
    // Sets the same obstacles, which stand still, to the state of another step.
    void set_obstacle_times(double t, std::vector<PenaltyArguments<Real>>& obstacles) const {
        for (PenaltyArguments<Real>& p : obstacles) p.time = t;
    }
    // Returns whether a contact takes energy from the cloth by its speed.
    bool has_damping_contact() const {
        return std::any_of(penalty_.begin(), penalty_.end(), [&](std::size_t number) {
            return plan_.spheres[number].dissipation > 0 || plan_.spheres[number].friction > 0;
        });
    }
    // Returns whether accelerations jump where a step from t0 to t1 of length h ends: the velocity
    // of a pin, an obstacle or the air does.
    bool has_kink_at(double t0, double t1, double h) const {
        const StageTime before = StageTime::of_stage(t0, h, 1);
        const StageTime after = StageTime::of_end(t1, h);
        const auto jumps = [&](const Motion& motion) {
            return motion.at(t1, before.inside).velocity != motion.at(t1, after.inside).velocity;
        };
        return std::any_of(plan_.pin_motions.begin(), plan_.pin_motions.end(), jumps) ||
            std::any_of(plan_.forces.begin(), plan_.forces.end(),
                        [&](const auto& force) { return jumps(force->motion); }) ||
            std::any_of(penalty_.begin(), penalty_.end(),
                        [&](std::size_t number) { return jumps(plan_.spheres[number].motion); });
    }
    bool obstacles_move() const {
        return std::any_of(penalty_.begin(), penalty_.end(), [&](std::size_t number) {
            return !plan_.spheres[number].motion.pieces.empty();
        });
    }
    // Returns how deep free points of a state, laid out like memory, are in the layer of each
    // obstacle.
    std::vector<Depth> depths_in(const AlignedVector<Real>& state, double t) const {
        return contact_depths(plan_, t, [&](auto see) {
            each_free_point([&](int i, std::ptrdiff_t at) { see(i, vector_at(state, at)); });
        });
    }
    // Calls `visit(i, where its first component lies in a state)` for each free point.
    template <class Visit>
    void each_free_point(Visit visit) const {
        for (int r = 0, i = 0; r < rows(); ++r)
            for (int c = 0; c < columns(); ++c, ++i)
                if (!plan_.cloth.pinned[std::size_t(i)]) visit(i, layout_.at(r, c));
    }
    // Returns the vector whose first component lies there.
    Vec3 vector_at(const AlignedVector<Real>& state, std::ptrdiff_t at) const {
        const auto value = [&](int k) {
            return points_.value(state, at + k * layout_.component());
        };
        return {value(0), value(1), value(2)};
    }

    // Make room for accelerations by forces on points. They are those of the constant force, and of
    // other forces on rows [begin, end) [N], in the layout of the kernel, which takes them in a
    // unit [m/s^2].
    virtual void make_room_for_forces() = 0;
    virtual void put_forces(const Points& forces, int begin, int end) = 0;
    virtual double unit_of_stored_forces() const { return 1; }
    const double* constant_row(int first_point) const {
        return plan_.has_force() ? constant_.row(first_point).data() : nullptr;
    }
    bool has_forces() const { return plan_.has_force() || !acting_.empty(); }
    void apply_constant_force() {
        make_room_for_forces();
        const double unit = unit_of_stored_forces();
        constant_.resize(plan_.cloth.points(), 3);
        scale_.resize(std::size_t(plan_.cloth.points()));
        for (int i = 0; i < plan_.cloth.points(); ++i) {
            constant_.row(i) = (plan_.field_at(i) - plan_.gravity) / unit;
            scale_[std::size_t(i)] = 1 / (plan_.cloth.mass[std::size_t(i)] * unit);
        }
        put_forces(Points::Zero(plan_.cloth.points(), 3), 0, rows());
    }
    // Places the pins of rows [begin, end) of a state that is laid out like memory.
    void place_pins(const StageTime& time, int begin, int end, AlignedVector<Real>& state) const {
        plan_.each_driven_pin(time, begin * columns(), end * columns(),
                              [&](int point, const Vec3& place, const Vec3& velocity) {
                                  points_.set(state, point, {place - origin_, velocity});
                              });
    }
    const RealKernels<Real>& kernels() const { return kernels_of<Real>(*plan_.kernels); }
    int rows() const { return plan_.cloth.rows; }
    int columns() const { return plan_.cloth.columns; }

    Plan plan_;
    Layout layout_;
    StatePoints<Real, Layout> points_;
    Vec3 origin_ = Vec3::Zero();  // of the positions in memory [m]
    AlignedVector<Real> memory_;
    // Whether data of the state that an engine keeps in memory still hold; false after every change
    // from elsewhere.
    bool state_known_ = false;
    PaperResponses<Real, Layout> responses_;
    // A force that the kernels do not compute, and its values on the mass points [N].
    struct Acting {
        std::shared_ptr<const Force> force;
        Points on_points;
    };
    std::vector<Acting> acting_;
    std::vector<double> powers_;  // by force and row [W], see measure_powers
    // These are in the unit of the kernel: accelerations by the constant force, and what a force of
    // 1 N makes of a point.
    Points constant_;
    std::vector<double> scale_;

private:
    void act_at_once(Acting& acting, const ForceState& state) {
        if (!force_failure) try {
                return acting.force->act(plan_.cloth, state, 0, rows(), acting.on_points.data());
            } catch (...) {
                force_failure = std::current_exception();
            }
        acting.on_points.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
    void apply_forces(int begin, int end) {
        const auto part = [&](auto& points) {
            return points.middleRows(begin * columns(), (end - begin) * columns());
        };
        // A pin takes no force, and no work.
        auto pin = std::lower_bound(pins_.begin(), pins_.end(), begin * columns());
        for (; pin != pins_.end() && *pin < end * columns(); ++pin)
            for (Acting& acting : acting_) acting.on_points.row(*pin).setZero();
        if (acting_.size() == 1) return put_forces(acting_[0].on_points, begin, end);
        part(sum_) = part(acting_[0].on_points);
        for (std::size_t k = 1; k < acting_.size(); ++k) part(sum_) += part(acting_[k].on_points);
        put_forces(sum_, begin, end);
    }
    PenaltyArguments<Real> penalty_arguments(const Sphere& sphere, std::size_t number,
                                             const StageTime& time, double unit, double factor,
                                             bool between_steps) const {
        const Surface surface = sphere.surface_at(time, origin_);
        const Vec3 velocity = sphere.velocity_at(time);
        PenaltyArguments<Real> p{};
        for (int k = 0; k < 3; ++k) {
            p.place[k] = Real(surface.place[k]);
            p.normal[k] = Real(surface.normal[k]);
            p.velocity[k] = Real(velocity[k]);
        }
        p.curvature = Real(surface.curvature);
        p.reach = Real(sphere.reach());
        p.push = Real(unit * sphere.stiffness / (sphere.thickness * sphere.thickness));
        p.dissipation = Real(sphere.dissipation);
        p.friction = Real(sphere.friction);
        p.slip2 = Real(sphere.slip_speed * sphere.slip_speed);
        fold_constants(p, sphere, surface);
        p.axis = -1;
        int side = clear_side_[number];
        double from = sphere.reach();
        if (sphere.flat()) {
            for (int k = 0; k < 3; ++k)
                if (std::abs(sphere.normal[k]) == 1) side = sphere.normal[k] > 0 ? k : k + 3;
        } else {
            from += sphere.radius;
        }
        if (side >= 0) {
            // Points beyond are clear whatever rounding does to their depth.
            constexpr double rounding = 32 * std::numeric_limits<Real>::epsilon();
            const Vec3 middle =
                sphere.flat() ? surface.place : Vec3(surface.place - sphere.radius * sphere.normal);
            p.axis = side % 3;
            p.side = side < 3 ? Real(1) : Real(-1);
            const double bound = double(p.side) * middle[p.axis] + from;
            p.bound = Real(bound + rounding * (std::abs(middle[p.axis]) + from));
        }
        p.number = int(number);
        p.weight = factor / unit;
        p.time = time.t;
        p.between_steps = between_steps;
        p.moves = !sphere.motion.pieces.empty();
        return p;
    }
    // Folds constants of an obstacle for the edge kernel.
    static void fold_constants(PenaltyArguments<Real>& p, const Sphere& sphere,
                               const Surface& surface) {
        // The radius up to which distances from the centre are good to 1e-14 m.
        constexpr double near = 100;
        if (!Layout::is_transposed) return;
        const double scale = std::cbrt(double(p.push));
        p.scale = Real(scale);
        p.direct = !compensated && sphere.radius <= near;
        if (sphere.flat()) {
            for (int k = 0; k < 3; ++k) p.place[k] = Real(scale * surface.normal[k]);
            p.scaled_reach = Real(scale * (double(p.reach) + surface.place.dot(surface.normal)));
        } else if (p.direct) {
            const Vec3 from_centre = surface.normal - surface.curvature * surface.place;
            for (int k = 0; k < 3; ++k) p.place[k] = Real(from_centre[k]);
            p.scaled_radius = Real(scale * sphere.radius);
            p.scaled_reach = Real(scale * (double(p.reach) + sphere.radius));
        }
    }
    // Sets the surface point from which gaps are measured: in this direction from the centre.
    static void set_normal(Sphere& sphere, const Vec3& direction) {
        if (sphere.penalty() && !sphere.flat()) sphere.normal = direction;
    }
    // Chooses in single the surface points that are nearest to the cloth's middle.
    void choose_normals(double t) {
        if (!compensated || penalty_.empty()) return;
        Vec3 sum = Vec3::Zero();
        for (int i = 0; i < plan_.cloth.points(); ++i) sum += points_.position(memory_, i);
        const Vec3 middle = sum / plan_.cloth.points();
        for (const std::size_t number : penalty_)
            set_normal(plan_.spheres[number],
                       normal_towards(plan_.spheres[number], middle, t, origin_));
    }
    void respond(double t, double dt, int threads) {
        const Responses responses = responses_.respond(memory_, t, dt, origin_, threads);
        contact_responses += responses.count;
        if (responses.changed) {
            state_known_ = false;
            watched.first_contact = std::min(watched.first_contact, t);
            watched.responded = true;
        }
        watched.point_depth = std::max(watched.point_depth, responses.depth);
    }
    // The cloth is in one strip.
    ComponentRows<Real> component(int k, int begin, int end) const {
        const VectorGeometry g = layout_.geometry(kernels().lanes);
        return {memory_.data() + layout_.first() + begin * g.row + k * g.component, g.row, g.vector,
                end - begin, g.vectors};
    }

    void stop_held_pins() {
        for (const int point : held_pins_) points_.set_velocity(memory_, point, Vec3::Zero());
    }
    // Returns 0 where the mean is not finite.
    Vec3 mean_velocity() const {
        Vec3 sum = Vec3::Zero();
        for (int i = 0; i < plan_.cloth.points(); ++i)
            for (int k = 0; k < 3; ++k) sum[k] += memory_[points_.place(i, k + 3)];
        return sum.allFinite() ? Vec3(sum / plan_.cloth.points()) : Vec3(Vec3::Zero());
    }
    // Returns whether the state is finite; padding is.
    bool finite() const {
        const Spans all = layout_.state_spans();
        std::atomic<bool> is{true};
        run_in_parts(all.count, int(std::min<std::ptrdiff_t>(parts(), all.count)),
                     [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                         const Real* const first =
                             memory_.data() + layout_.first() + begin * all.stride;
                         if (!kernels().all_finite(first, Spans{end - begin, all.size, all.stride}))
                             is = false;
                     });
        return is;
    }
    // Returns the threads for copies: the team of the steps, in whose caches the state is, or one.
    // Of another team some would end.
    int parts() const {
        const int team = RowBand::team(rows(), threads);
        return plan_.cloth.points() >= heuristics::points_per_thread_of_copy * team ? team : 1;
    }
    // Calls `visit(place)` in the order of SavedState::values.
    template <class Visit>
    void each_saved_place(Visit visit) const {
        for (int part = 0; part < (compensated ? 4 : 2); ++part)
            for (int i = 0; i < plan_.cloth.points(); ++i)
                for (int k = 0; k < 3; ++k)
                    visit(points_.place(i, part % 2 * 3 + k) +
                          (part < 2 ? 0 : layout_.compensation()));
    }

    template <class In>
    bool load_any(double t, const In* x, const In* v) {
        origin_ = compensated ? far_origin(x) : Vec3(Vec3::Zero());
        state_known_ = false;
        run_in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
            for (int r = int(begin); r < int(end); ++r) {
                put_row(x + std::ptrdiff_t(r) * 3 * columns(), r, 0, origin_);
                put_row(v + std::ptrdiff_t(r) * 3 * columns(), r, 3, Vec3::Zero());
            }
        });
        stop_held_pins();
        choose_normals(t);
        return finite();
    }
    template <class Out>
    void store_any(Out* x, Out* v) const {
        run_in_parts(rows(), parts(), [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
            for (int r = int(begin); r < int(end); ++r) {
                if (x) take_row(r, 0, origin_, x + std::ptrdiff_t(r) * 3 * columns());
                if (v) take_row(r, 3, Vec3::Zero(), v + std::ptrdiff_t(r) * 3 * columns());
            }
        });
    }
    // Writes three components of a row, from the first on, relative to `origin`. A difference keeps
    // the sign of a zero.
    template <class In>
    void put_row(const In* from, int r, int first, const Vec3& origin) {
        const std::ptrdiff_t size = layout_.component();
        const std::ptrdiff_t low = layout_.compensation();
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
        const std::ptrdiff_t size = layout_.component();
        const std::ptrdiff_t low = layout_.compensation();
        const Real* const row = memory_.data() + layout_.at(r, 0, first);
        const Vec3 shift = Vec3::Zero() - origin;
        for (int c = 0; c < columns(); ++c, to += 3) {
            const Real* const from = row + layout_.in_row(c);
            for (int k = 0; k < 3; ++k) {
                if constexpr (compensated)
                    to[k] = Out(double(from[k * size]) + double(from[k * size + low]) - shift[k]);
                else to[k] = Out(from[k * size]);
            }
        }
    }

    // float32 resolves points of a cloth far from 0 no better than by 6e-8 of that distance. So in
    // single memory holds positions relative to an origin, 0 unless the cloth is far off for its
    // size.
    template <class In>
    Vec3 far_origin(const In* x) const {
        // All points of a far cloth are near to each other for their distance from 0. Two corners
        // nearly always tell that it is not far.
        const auto point = [&](std::ptrdiff_t i) {
            return Vec3(double(x[3 * i]), double(x[3 * i + 1]), double(x[3 * i + 2]));
        };
        const Vec3 first = point(0);
        const Vec3 last = point(plan_.cloth.points() - 1);
        if (heuristics::extents_that_are_far * (last - first).norm() >= 2 * first.norm())
            return Vec3::Zero();
        // What is no number does not count.
        Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
        Vec3 high = -low;
        for (int i = 0; i < plan_.cloth.points(); ++i)
            for (int k = 0; k < 3; ++k) {
                const double value = double(x[3 * std::ptrdiff_t(i) + k]);
                low[k] = value < low[k] ? value : low[k];
                high[k] = value > high[k] ? value : high[k];
            }
        const Vec3 middle = low / 2 + high / 2;
        const bool far = middle.norm() > heuristics::extents_that_are_far * (high - low).norm();
        return far && middle.norm() < double(std::numeric_limits<float>::max())
            ? middle
            : Vec3(Vec3::Zero());
    }
    Points sum_;  // of several forces [N]
    Points acting_x_, acting_v_;  // of the state on which forces act
    std::vector<int> pins_, held_pins_;
    std::vector<std::size_t> penalty_;  // numbers of obstacles
    std::vector<int> clear_side_ = std::vector<int>(plan_.spheres.size(), -1);
    AlignedVector<Real> checkpoint_;
    Tally tally_at_checkpoint_;
};

}  // namespace clothsim
