// Every integrator but the fused RK4 of the kernels, on top of an engine that evaluates
// accelerations at any state. Each thread has a band of rows, and combines states and accelerations
// row by row.
//
// A family of methods is a way through the state, two stages, and a slot of accelerations for each
// stage.
//
//     explicit Runge-Kutta    state --a0--> stage 0 --a1--> stage 1 --a2--> stage 0 ... --> state
//                               |_____________|_______________|_____ each from the state and all
//                                                                    slopes
//     with error control      the same, but the end goes to `result_`: an accepted step swaps it
//                             with the state, a rejected one leaves the state alone. `previous_`
//                             serves dense output.
//     stabilised              as with error control; two increments and two stages take turns, and
//                             one slot serves all accelerations between the first and the last
//     splitting               state --drift--> state --kick a0--> state --drift--> ..., in place
//     implicit                state --ImplicitMidpoint--> state, by Newton's method, one thread
//
// An arrow is a sweep: it reads one version of the state row by row. It makes the next version of a
// row as soon as its accelerations are known, so that the row is still in cache. A barrier ends it.
// Splittings overwrite the state in place, and need another between drift and kick. After the last
// arrow: driven pins are placed.
#include "engines/engine.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <stdexcept>

#include "engines/edge_engine.hpp"
#include "engines/gather_engine.hpp"
#include "integrators/adaptive.hpp"
#include "integrators/implicit.hpp"
#include "integrators/methods.hpp"
#include "integrators/rkc2.hpp"
#include "measure/diagnostics.hpp"

namespace clothsim {
namespace {

template <class Real, class Base>
class SchemeEngine final : public Base, public AdaptiveEngine {
public:
    explicit SchemeEngine(const Plan& plan)
        : Base(plan),
          method_(method_of(plan.integrator)),
          field_(this->field()),
          stage_field_(field_) {
        stage_field_.compensation = 0;
        // A force that the kernels do not compute may depend on velocities too.
        const bool damped = !this->plan_.forces.empty() || this->plan_.cloth.has_spring_damping() ||
            this->has_damping_contact();
        explicit_ = damped && method_.damped ? method_.damped : method_.runge_kutta;
        if (method_.implicit()) {
            implicit_ = std::make_unique<ImplicitMidpoint>(this->plan_);
            return;
        }
        const bool adaptive = this->adaptive() != nullptr;
        int count = explicit_ ? explicit_->stages + int(adaptive) : 1;
        if (method_.stabilised) count = 3;
        for (int i = 0; i < count; ++i) slot_.push_back(i);
        accelerations_.assign(std::size_t(count * field_.acceleration_size), Real(0));
        first_contacts_ = end_contacts_ = step_contacts_ = this->contacts;
        first_power_ = end_power_ = step_work_ = this->work_rows;
        // These are copies of the engine's memory, for its padding.
        if (explicit_ || adaptive)
            for (auto& stage : stages_) stage = this->memory_;
        if (method_.stabilised) {
            modes_ = mode_bounds(this->plan_.cloth);
            for (auto& increment : increments_) increment = this->memory_;
            row_squares_.emplace_back(std::size_t(this->rows()));
        }
        if (adaptive) result_ = previous_ = this->memory_;
        for (std::size_t e = 0; explicit_ && e < explicit_->errors.size(); ++e)
            row_squares_.emplace_back(std::size_t(this->rows()));
    }

    void advance(std::int64_t steps, const Clock& clock, int threads) override {
        if (method_.stabilised)
            throw std::logic_error("the method takes no steps of a given length");
        this->choose_sides(clock.at(0));
        if (implicit_) {
            for (std::int64_t k = 1; k <= steps; ++k) {
                advance_implicit(clock.at(k - 1), clock.dt);
                this->place_pins(StageTime::of_end(clock.at(k), clock.dt), 0, this->rows(),
                                 this->memory_);
            }
            return;
        }
        bool has_next_start = false;
        if (explicit_) plan_stages(clock.dt, this->memory_);
        in_bands(threads, [&](FieldBand<Real>& band, Barrier& barrier) {
            bool has_start = this->state_known_;
            for (std::int64_t k = 1; k <= steps; ++k) {
                const double t = clock.at(k - 1);
                if (explicit_) {
                    advance_explicit(band, barrier, t, clock.at(k));
                    continue;
                }
                advance_splitting(band, barrier, t, clock.dt, has_start);
                this->place_pins(StageTime::of_end(clock.at(k), clock.dt), band.begin, band.end,
                                 this->memory_);
                has_start = method_.splitting->first_same_as_last() &&
                    !this->has_kink_at(t, clock.at(k), clock.dt);
                barrier.wait();
            }
            if (band.begin == 0) has_next_start = has_start;
        });
        this->state_known_ = has_next_start;
    }

    AdaptiveEngine* adaptive() override {
        const bool estimates = method_.stabilised || (explicit_ && !explicit_->errors.empty());
        return estimates ? this : nullptr;
    }

    int order() const override {
        return explicit_ ? explicit_->order : ChebyshevMethod::error_order;
    }

    double try_step(double t, double h, const Tolerance& tolerance, int threads) override {
        this->choose_sides(t);
        if (method_.stabilised) return try_stabilised(t, h, tolerance, threads);
        const ExplicitMethod& m = *explicit_;
        plan_stages(h, this->memory_);
        std::array<Combination<Real>, 2> errors;
        for (std::size_t e = 0; e < m.errors.size(); ++e)
            errors[e] = combination(m.errors[e], h, 1 / tolerance.x, 1 / tolerance.v);
        const auto estimate = [&](int begin, int end) {
            for (std::size_t e = 0; e < m.errors.size(); ++e)
                this->kernels().square(field_, begin, end, this->memory_.data(), errors[e],
                                       row_squares_[e].data());
        };
        in_bands(threads, [&](FieldBand<Real>& band, Barrier& barrier) {
            run_stages(band, barrier, t, this->state_known_, [&](int begin, int end) {
                this->kernels().advance(field_, begin, end, this->memory_.data(), result_.data(),
                                        result_sum_);
                this->place_pins(StageTime::of_stage(t, h, 1), begin, end, result_);
                if (!m.error_needs_end) estimate(begin, end);
            });
            if (m.error_needs_end)
                sweep(band, barrier, result_, m.stages, StageTime::of_stage(t, h, 1), estimate);
        });
        this->state_known_ = true;
        step_ = h;
        step_begin_ = t;
        double squares[2] = {0, 0};
        for (std::size_t e = 0; e < m.errors.size(); ++e)
            for (const RowSquares& row : row_squares_[e]) squares[e] += row.x + row.v;
        const double points = this->plan_.cloth.points();
        if (m.errors.size() == 1) return std::sqrt(squares[0] / points);
        // As in dop853.f, the estimate of order 5 is held down where that of order 3 is much
        // larger.
        if (squares[0] == 0) return 0;
        return squares[0] / std::sqrt((squares[0] + 0.01 * squares[1]) * points);
    }

    void accept_step(double t) override {
        previous_.swap(this->memory_);
        this->memory_.swap(result_);
        add_sums_of_step(0, this->rows());
        if (has_acceleration_at_end()) {
            std::swap(first_contacts_, end_contacts_);
            std::swap(first_power_, end_power_);
        }
        const bool kink = this->has_kink_at(step_begin_, t, step_);
        // The velocity after a kink counts from here on, and so another acceleration.
        const StageTime after = StageTime::of_end(t, step_);
        this->place_pins(after, 0, this->rows(), this->memory_);
        // The acceleration at the end is the first one of the next step.
        if (has_acceleration_at_end()) std::swap(slot_.front(), slot_.back());
        this->state_known_ = has_acceleration_at_end() && !kink;
    }

    double contact_step(double t, double h, double near, bool after_trial) override {
        double allowed = h;
        if (method_.stabilised && !after_trial) {
            const ModeBounds modes = modes_with_forces();
            allowed = std::min(allowed, longest_chebyshev_step(modes.stiffness, modes.damping));
        }
        for (const Sphere& sphere : this->plan_.spheres) {
            if (sphere.penalty()) continue;
            // The sphere's own speed depends on the step.
            for (double previous = 2 * h; allowed < 0.9 * previous;) {
                previous = allowed;
                allowed = contact_step(sphere, t, previous, near, after_trial);
            }
        }
        allowed = after_trial && h > near ? std::max(allowed, near) : allowed;
        for (const Sphere& sphere : this->plan_.spheres)
            if (sphere.penalty())
                for (double previous = 2 * allowed; allowed < 0.9 * previous;) {
                    previous = allowed;
                    allowed = penalty_step(sphere, t, previous, after_trial);
                }
        return allowed;
    }
    std::vector<Depth> trial_depths(double t) const override { return this->depths_in(result_, t); }

    void dense(double t, double* x, double* v, int threads) override {
        const double part = (t - step_begin_) / step_;
        const bool interpolated = has_acceleration_at_end();
        // The first and the last acceleration have changed places since the step.
        if (interpolated) std::swap(slot_.front(), slot_.back());
        ChebyshevSum<Real> hermite;
        if (method_.stabilised) hermite = hermite_sum(part);
        else plan_stages(interpolated ? step_ : part * step_, previous_);
        if (explicit_ && interpolated) result_sum_ = combination(explicit_->dense(part), step_);
        const auto finish = [&](int begin, int end) {
            if (method_.stabilised)
                this->kernels().chebyshev(stage_field_, begin, end, previous_.data(),
                                          increment_of_step().data(), stages_[0].data(),
                                          result_.data(), hermite);
            else
                this->kernels().advance(stage_field_, begin, end, previous_.data(), result_.data(),
                                        result_sum_);
            this->place_pins(StageTime::of_stage(step_begin_, step_, part), begin, end, result_);
        };
        in_bands(threads, [&](FieldBand<Real>& band, Barrier& barrier) {
            if (!interpolated) run_stages(band, barrier, step_begin_, true, finish);
            else finish(band.begin, band.end);
        });
        if (interpolated) std::swap(slot_.front(), slot_.back());
        for (int i = 0; i < this->plan_.cloth.points(); ++i) {
            Eigen::Map<Vec3>(x + 3 * std::ptrdiff_t(i)) = vector_in(result_, i, 0) + this->origin_;
            Eigen::Map<Vec3>(v + 3 * std::ptrdiff_t(i)) = vector_in(result_, i, 3);
        }
    }

private:
    // The mean velocity of an obstacle in a step, and the most by which its velocity differs.
    struct Travel {
        Vec3 velocity;
        double deviation;
    };
    static Travel mean_travel(const Sphere& sphere, double t, double h) {
        const Vec3 travel = (sphere.center_at(t + h) - sphere.center_at(t)) / h;
        // A step lies on one piece of the motion. A component of the velocity is monotone there or
        // quadratic, and so differs most from its mean at an end (Legendre polynomials are largest
        // at the ends).
        Vec3 most = Vec3::Zero();
        for (const double part : {0.0, 1.0}) {
            const StageTime end = StageTime::of_stage(t, h, part);
            most = most.cwiseMax((sphere.velocity_at(end) - travel).cwiseAbs());
        }
        return {travel, most.norm()};
    }
    // Advances conservatively: a point closes on the surface by its gap and half the layer at most.
    double penalty_step(const Sphere& sphere, double t, double h, bool after_trial) {
        const Travel travel = mean_travel(sphere, t, h);
        const PenaltyContact contact(sphere, StageTime::of_stage(t, h, 0), this->origin_);
        const auto speed_of = [&](const Vec3& velocity) {
            const Vec3 relative = velocity - travel.velocity;
            return sphere.flat() ? std::max(-relative.dot(sphere.normal), 0.0) : relative.norm();
        };
        const std::ptrdiff_t to_velocity = 3 * this->layout_.component();
        double allowed = h;
        this->each_free_point([&](int, std::ptrdiff_t at) {
            double speed = speed_of(this->vector_at(this->memory_, at + to_velocity));
            if (after_trial)
                speed = std::max(speed, speed_of(this->vector_at(result_, at + to_velocity)));
            speed += travel.deviation;
            if (speed * allowed <= sphere.thickness / 2) return;
            const double depth = contact.at(this->vector_at(this->memory_, at)).depth;
            const double way = std::max(sphere.thickness - depth, 0.0) + sphere.thickness / 2;
            if (speed * allowed > way) allowed = way / speed;
        });
        return allowed;
    }
    double contact_step(const Sphere& sphere, double t, double h, double near, bool after_trial) {
        const Surface surface = sphere.surface_at(t, this->origin_);
        const Travel moved = mean_travel(sphere, t, h);
        const Vec3& travel = moved.velocity;
        const Cloth& cloth = this->plan_.cloth;
        const double sphere_speed = moved.deviation;
        const double least_gap = contact_fraction *
            std::min(sphere.contact_radius(),
                     std::hypot((cloth.rows - 1) * cloth.row_spacing,
                                (cloth.columns - 1) * cloth.column_spacing));
        double allowed = h;
        for (int i = 0; i < this->plan_.cloth.points(); ++i) {
            if (this->plan_.cloth.pinned[std::size_t(i)]) continue;
            const PointState point = this->points_.get(this->memory_, i);
            double speed = (point.velocity - travel).norm();
            if (after_trial) speed = std::max(speed, (vector_in(result_, i, 3) - travel).norm());
            speed += sphere_speed;
            const double level = surface.level(point.position - surface.place);
            const double gap = std::max(surface.height(level) - sphere.offset, 0.0);
            if (speed * allowed > gap)
                allowed =
                    std::min(allowed, std::max(gap / speed, std::min(near, least_gap / speed)));
        }
        return allowed;
    }

    // Calls `work(band, barrier)` on at most `threads` threads.
    template <class Work>
    void in_bands(int threads, Work work) {
        const int team = granted_threads(RowBand::team(this->rows(), threads));
        Barrier barrier(team);
        bands_.resize(std::size_t(team));
        run_team(team, [&](int thread) {
            FieldBand<Real>& band = bands_[std::size_t(thread)];
            band.begin = this->rows() * thread / team;
            band.end = this->rows() * (thread + 1) / team;
            work(band, barrier);
        });
    }

    // Returns the number of the acceleration at the end of a step.
    int stages() const {
        if (method_.stabilised) return chebyshev_->stages;
        return explicit_ ? explicit_->stages : 1;
    }
    // Returns whether a step ends with the acceleration at its end, which is the first of the next.
    bool has_acceleration_at_end() const {
        return method_.stabilised || explicit_->error_needs_end;
    }
    Real* acceleration(int index) {
        std::size_t place = std::size_t(index);
        if (method_.stabilised && index > 0) place = index == stages() ? 2 : 1;
        return accelerations_.data() + slot_[place] * field_.acceleration_size;
    }
    // Computes accelerations at a version of the state into slot `index`; after some rows
    // `then(begin, end)` makes the next version of them.
    template <class Then>
    void sweep(FieldBand<Real>& band, Barrier& barrier, const AlignedVector<Real>& state, int index,
               const StageTime& time, Then then) {
        begin_contacts(band, index, time);
        let_forces_act(band, barrier, state, index, time);
        this->begin_sweep(state.data(), acceleration(index), band);
        int first = 0;
        for (int begin = 0; begin < band.size(); begin += rows_at_once_) {
            const int end =
                this->sweep_rows(begin, std::min(begin + rows_at_once_, band.size()), band);
            then(band.row(first), band.row(end));
            first = end;
        }
        if (band.begin == 0) ++this->evaluations;
        barrier.wait();
    }
    void sweep(FieldBand<Real>& band, Barrier& barrier, const StageTime& time) {
        sweep(band, barrier, this->memory_, 0, time, [](int, int) {});
    }
    // Places the obstacles for accelerations into slot `index`. What they do in the first stage and
    // at the end of a step is kept, as the next step may begin with it; other stages add to the
    // step's.
    void begin_contacts(FieldBand<Real>& band, int index, const StageTime& time) {
        if (!this->has_penalty()) return;
        const bool first = index == 0;
        const bool end = index == stages();
        const double weight = first || end ? 1 : impulse_weight(index);
        ContactTally& other_sums = end ? end_contacts_ : step_contacts_;
        ContactTally& sums = first ? first_contacts_ : other_sums;
        if (first || end) sums.clear_rows(band.begin, band.end);
        this->place_obstacles(time, this->newton_in_sums(), weight, first || end, band.obstacles);
        band.contacts = this->penalty_rows(band.obstacles, sums);
    }
    // Adds the forces that the kernels do not compute. Their power is kept as contacts are.
    void let_forces_act(FieldBand<Real>& band, Barrier& barrier, const AlignedVector<Real>& state,
                        int index, const StageTime& time) {
        this->act(state, time, band.begin, band.end, barrier);
        this->each_force_sum(band.begin, band.end, [&](std::size_t at) {
            const double power = this->powers_[at];
            if (index == 0) first_power_[at] = power;
            else if (index == stages()) end_power_[at] = power;
            else step_work_[at] += impulse_weight(index) * power;
        });
    }
    // Returns the weight of a stage's acceleration in the velocity at the end of the planned step
    // [s].
    double impulse_weight(int stage) const {
        const auto& weights = explicit_ ? explicit_->result.v : chebyshev_->weights;
        return weights[std::size_t(stage)] * planned_step_;
    }
    void begin_sums_of_step(const FieldBand<Real>& band) {
        if (this->has_penalty()) step_contacts_.clear_rows(band.begin, band.end);
        this->each_force_sum(band.begin, band.end, [&](std::size_t at) { step_work_[at] = 0; });
    }
    // Adds what obstacles and forces did in the step.
    void add_sums_of_step(int begin, int end) {
        this->each_force_sum(begin, end, [&](std::size_t at) {
            this->work_rows[at] += impulse_weight(0) * first_power_[at] + step_work_[at];
        });
        if (!this->has_penalty()) return;
        this->contacts.add_rows(first_contacts_, impulse_weight(0), true, begin, end);
        this->contacts.add_rows(step_contacts_, 1, false, begin, end);
    }
    // Adds the work of a kick of h with the forces of the last sweep, or half of it, at the
    // velocities in memory.
    void add_work_of_kick(const FieldBand<Real>& band, double h) {
        this->read_acting_velocities(band.begin, band.end);
        this->measure_powers(band.begin, band.end);
        this->each_force_sum(band.begin, band.end,
                             [&](std::size_t at) { this->work_rows[at] += h * this->powers_[at]; });
    }
    Combination<Real> combination(const Weights& w, double h, double scale_x = 1,
                                  double scale_v = 1) {
        Combination<Real> sum;
        sum.drift = Real(w.drift * h);
        for (std::size_t l = 0; l < w.v.size(); ++l)
            if (w.x[l] != 0 || w.v[l] != 0)
                sum.add(acceleration(int(l)), w.x[l] * h * h * scale_x, w.v[l] * h * scale_v);
        return sum;
    }
    void kick_drift(const FieldBand<Real>& band, double drift, double kick, double kick_in_x) {
        Combination<Real> sum;
        sum.drift = Real(drift);
        sum.add(acceleration(0), kick_in_x, kick);
        this->kernels().advance(field_, band.begin, band.end, this->memory_.data(),
                                this->memory_.data(), sum);
    }

    // Plans the sums of a step of h from `from`, for `run_stages`.
    void plan_stages(double h, const AlignedVector<Real>& from) {
        from_ = from.data();
        planned_step_ = h;
        stage_sums_.clear();
        for (int s = 1; s < explicit_->stages; ++s)
            stage_sums_.push_back(combination(explicit_->stage[std::size_t(s)], h));
        result_sum_ = combination(explicit_->result, h);
    }
    // Runs the sweeps of a planned step from time t. `has_start`: the acceleration at its start is
    // known. `finish(begin, end)` is called for rows after the last sweep.
    template <class Finish>
    void run_stages(FieldBand<Real>& band, Barrier& barrier, double t, bool has_start,
                    Finish finish) {
        const auto time = [&](int s) {
            const double part = s == 0 ? 0 : explicit_->stage[std::size_t(s)].drift;
            return StageTime::of_stage(t, planned_step_, part);
        };
        begin_sums_of_step(band);
        if (explicit_->stages == 1) {  // the result takes the place of the state
            sweep(band, barrier, time(0));
            finish(band.begin, band.end);
            return barrier.wait();
        }
        const auto next_stage = [&](int s) {
            return [this, s, t](int begin, int end) {
                auto& stage = stages_[(s + 1) & 1];
                this->kernels().advance(stage_field_, begin, end, from_, stage.data(),
                                        stage_sums_[std::size_t(s)]);
                const double part = explicit_->stage[std::size_t(s + 1)].drift;
                this->place_pins(StageTime::of_stage(t, planned_step_, part), begin, end, stage);
            };
        };
        if (has_start) {
            next_stage(0)(band.begin, band.end);
            barrier.wait();
        } else {
            sweep(band, barrier, this->memory_, 0, time(0), next_stage(0));
        }
        const int last = explicit_->stages - 1;
        for (int s = 1; s < last; ++s)
            sweep(band, barrier, stages_[s & 1], s, time(s), next_stage(s));
        sweep(band, barrier, stages_[last & 1], last, time(last), finish);
    }

    // Tries a step of RKC2 with as many stages as the damping asks for, at its start and, as layers
    // may be deeper there, at its end.
    double try_stabilised(double t, double h, const Tolerance& tolerance, int threads) {
        double rate = damping_rate(this->memory_, t);
        for (;;) {
            const int stages = chebyshev_stages(rate, h);
            if (!chebyshev_ || chebyshev_->stages != stages) chebyshev_.emplace(stages);
            const double error = try_stages(t, h, tolerance, threads);
            if (!(error <= 1)) return error;
            const double at_end = damping_rate(result_, t + h);
            if (chebyshev_stages(at_end, h) <= stages + stages / spare_stages) return error;
            rate = at_end;
        }
    }
    double try_stages(double t, double h, const Tolerance& tolerance, int threads) {
        planned_step_ = h;
        const int stages = chebyshev_->stages;
        const auto time = [&](int j) {
            return StageTime::of_stage(t, h, chebyshev_->stage[std::size_t(j)].part);
        };
        // Makes stage j from the acceleration of the stage before.
        const auto make = [&](int j) {
            return [this, j, last = j == stages, sum = stage_sum(j), at = time(j)](int begin,
                                                                                   int end) {
                AlignedVector<Real>& to = last ? result_ : stages_[j & 1];
                this->kernels().chebyshev(last ? field_ : stage_field_, begin, end,
                                          this->memory_.data(), increments_[(j - 1) & 1].data(),
                                          increments_[j & 1].data(), to.data(), sum);
                this->place_pins(at, begin, end, to);
            };
        };
        const ChebyshevSum<Real> error = error_sum(tolerance);
        const auto estimate = [&](int begin, int end) {
            this->kernels().chebyshev_square(field_, begin, end, this->memory_.data(),
                                             increment_of_step().data(), error,
                                             row_squares_[0].data());
        };
        in_bands(threads, [&](FieldBand<Real>& band, Barrier& barrier) {
            begin_sums_of_step(band);
            if (this->state_known_) {
                make(1)(band.begin, band.end);
                barrier.wait();
            } else {
                sweep(band, barrier, this->memory_, 0, time(0), make(1));
            }
            for (int j = 1; j < stages; ++j)
                sweep(band, barrier, stages_[j & 1], j, time(j), make(j + 1));
            sweep(band, barrier, result_, stages, time(stages), estimate);
        });
        this->state_known_ = true;
        step_ = h;
        step_begin_ = t;
        double squares = 0;
        for (const RowSquares& row : row_squares_[0]) squares += row.x + row.v;
        return std::sqrt(squares / this->plan_.cloth.points());
    }
    const AlignedVector<Real>& increment_of_step() const {
        return increments_[chebyshev_->stages & 1];
    }
    ChebyshevSum<Real> sum_of(double last, double previous, double slope, double first_slope,
                              int a_last) {
        return {Real(last),
                Real(previous),
                Real(slope * planned_step_),
                Real(first_slope * planned_step_),
                acceleration(a_last),
                acceleration(0)};
    }
    ChebyshevSum<Real> stage_sum(int j) {
        const ChebyshevMethod::StageWeights& stage = chebyshev_->stage[std::size_t(j)];
        return sum_of(stage.mu, stage.nu, stage.slope, stage.first_slope, j - 1);
    }
    ChebyshevSum<Real> error_sum(const Tolerance& tolerance) {
        constexpr double slopes = ChebyshevMethod::error_of_slopes;
        ChebyshevSum<Real> sum =
            sum_of(ChebyshevMethod::error_of_increment, 0, slopes, slopes, stages());
        sum.scale_x = Real(1 / tolerance.x);
        sum.scale_v = Real(1 / tolerance.v);
        return sum;
    }
    // Returns the cubic polynomial through both ends of the step with their slopes, at a part of
    // it.
    ChebyshevSum<Real> hermite_sum(double part) {
        const double remainder = 1 - part;
        planned_step_ = step_;
        return sum_of(part * part * (3 - 2 * part), 0, -part * part * remainder,
                      part * remainder * remainder, stages());
    }
    ModeBounds modes_with_forces() const {
        ModeBounds modes = modes_;
        const double speed = this->plan_.forces.empty() ? 0 : this->speed_bound();
        for (const auto& force : this->plan_.forces)
            modes.damping += force->damping_bound(this->plan_.cloth, speed);
        return modes;
    }
    // Returns a rate above the damping rates of the modes at a state, and in a layer above its
    // frequency [1/s].
    double damping_rate(const AlignedVector<Real>& state, double t) const {
        ModeBounds modes = modes_with_forces();
        if (this->has_penalty()) {
            const std::vector<Depth> depths = this->depths_in(state, t);
            double stiffness = 0;
            double damping = 0;
            for (std::size_t k = 0; k < depths.size(); ++k) {
                if (!(depths[k].depth > 0)) continue;
                const Sphere& obstacle = this->plan_.spheres[k];
                const double part = depths[k].depth / obstacle.thickness;
                const double push = obstacle.stiffness * depths[k].depth * part * part;
                stiffness += 6 * obstacle.stiffness * part * part;
                damping +=
                    push * (obstacle.dissipation + 2 * obstacle.friction / obstacle.slip_speed);
            }
            const double mobility = this->plan_.cloth.largest_mobility();
            modes.stiffness += stiffness * mobility;
            modes.damping += damping * mobility;
        }
        return std::max(modes.damping, std::sqrt(modes.stiffness));
    }

    void advance_explicit(FieldBand<Real>& band, Barrier& barrier, double t0, double t) {
        run_stages(band, barrier, t0, false, [&](int begin, int end) {
            this->kernels().advance(field_, begin, end, this->memory_.data(), this->memory_.data(),
                                    result_sum_);
            this->place_pins(StageTime::of_end(t, planned_step_), begin, end, this->memory_);
        });
        add_sums_of_step(band.begin, band.end);
    }
    // `has_start`: the acceleration at the start is known.
    void advance_splitting(FieldBand<Real>& band, Barrier& barrier, double t, double h,
                           bool has_start) {
        const Splitting& s = *method_.splitting;
        double part = s.drifts[0];  // of the step: time passes in drifts
        if (part != 0) {
            kick_drift(band, part * h, 0, 0);
            place_stage_pins(band, t, h, part);
            barrier.wait();
        }
        for (std::size_t i = 0; i < s.kicks.size(); ++i) {
            if (i > 0) barrier.wait();
            if (i > 0 || !has_start) sweep(band, barrier, StageTime::of_stage(t, h, part));
            if (this->has_penalty())
                this->contacts.add_rows(first_contacts_, s.kicks[i] * h, true, band.begin,
                                        band.end);
            // Over a kick the mean velocity is that of its ends.
            add_work_of_kick(band, s.kicks[i] * h / 2);
            kick_drift(band, s.drifts[i + 1] * h, s.kicks[i] * h,
                       s.drifts[i + 1] * s.kicks[i] * h * h);
            add_work_of_kick(band, s.kicks[i] * h / 2);
            place_stage_pins(band, t, h, part += s.drifts[i + 1]);
        }
    }
    void place_stage_pins(const FieldBand<Real>& band, double t, double h, double part) {
        this->place_pins(StageTime::of_stage(t, h, part), band.begin, band.end, this->memory_);
    }
    void advance_implicit(double t, double h) {
        Points x(this->plan_.cloth.points(), 3);
        Points v(this->plan_.cloth.points(), 3);
        this->store(x.data(), v.data());
        const Points x0 = x;
        const Points v0 = v;
        this->evaluations += implicit_->step(x, v, t, h, this->force_failure);
        auto work = this->work_rows.begin();
        for (std::size_t k = 0; k < this->plan_.forces.size(); ++k) {
            if (this->plan_.forces[k]->in_kernels()) continue;
            *work += implicit_->work(k);
            work += this->rows();
        }
        note_implicit_contacts(t, h, x0, v0, x, v);
        for (int i = 0; i < x.rows(); ++i)
            this->points_.set(this->memory_, i, {x.row(i).transpose() - this->origin_, v.row(i)});
    }

    // Notes the contacts of a step of the midpoint rule, whose stage is the mean of its ends.
    void note_implicit_contacts(double t, double h, const Points& x0, const Points& v0,
                                const Points& x1, const Points& v1) {
        for (std::size_t s = 0; s < this->plan_.spheres.size(); ++s) {
            const Sphere& sphere = this->plan_.spheres[s];
            if (!sphere.penalty()) continue;
            const PenaltyContact begin(sphere, StageTime::of_stage(t, h, 0), this->origin_);
            const PenaltyContact middle(sphere, StageTime::of_stage(t, h, 0.5), this->origin_);
            for (int i = 0; i < x0.rows(); ++i) {
                if (this->plan_.cloth.pinned[std::size_t(i)]) continue;
                double* const record = this->contacts.record(s, i / this->columns());
                const auto place = [&](const Vec3& x) { return Vec3(x - this->origin_); };
                const Vec3 f = middle.force(place((x0.row(i) + x1.row(i)).transpose() / 2),
                                            (v0.row(i) + v1.row(i)).transpose() / 2);
                const double depth = begin.at(place(x0.row(i).transpose())).depth;
                this->contacts.add(record, h * f, middle.velocity);
                if (depth > 0) this->contacts.note_depth(record, depth, t);
            }
        }
    }

    // Returns three components from `first` on: 0 for the position, or 3 for the velocity.
    Vec3 vector_in(const AlignedVector<Real>& state, int i, int first) const {
        const auto at = [&](int k) {
            return double(state[std::size_t(this->points_.place(i, first + k))]);
        };
        return {at(0), at(1), at(2)};
    }

    // One of so many stages may be missing at the end of a step, as the bounds are not reached.
    static constexpr int spare_stages = 8;

    const Method method_;
    const ExplicitMethod* explicit_;
    FieldLayout field_, stage_field_;  // of the state; of a stage, which has no compensation
    int rows_at_once_ = int(std::clamp<std::ptrdiff_t>(
        heuristics::bytes_at_once / (field_.row * std::ptrdiff_t(sizeof(Real))), 1,
        heuristics::most_rows_at_once));
    std::unique_ptr<ImplicitMidpoint> implicit_;
    AlignedVector<Real> accelerations_;
    // Contacts of the first acceleration, of that at the end of a step, and of those between.
    ContactTally first_contacts_, end_contacts_, step_contacts_;
    std::vector<double> first_power_, end_power_, step_work_;  // of forces likewise, see work_rows
    std::vector<int> slot_;  // where the acceleration of a stage lies
    std::array<AlignedVector<Real>, 2> stages_;
    std::optional<ChebyshevMethod> chebyshev_;  // of the newest step
    ModeBounds modes_{};  // of the springs
    std::array<AlignedVector<Real>, 2> increments_;
    std::vector<FieldBand<Real>> bands_;
    const Real* from_ = nullptr;  // where the planned step starts, and its sums
    std::vector<Combination<Real>> stage_sums_;
    Combination<Real> result_sum_;

    AlignedVector<Real> result_, previous_;  // of the step tried, and before the step accepted
    std::vector<std::vector<RowSquares>> row_squares_;
    double planned_step_ = 0;  // step of the sums [s]
    double step_ = 0, step_begin_ = 0;  // of the step tried [s]
};

template <class Real>
std::unique_ptr<Engine> make(const Plan& plan) {
    const bool gather = plan.kernel == Kernel::gather;
    const bool whole_states = std::any_of(plan.forces.begin(), plan.forces.end(),
                                          [](const auto& force) { return !force->in_kernels(); });
    // The gather kernel's own steps know pins that rest, as the compute shader does.
    if (method_of(plan.integrator).in_kernels && !whole_states &&
        !(gather && plan.has_driven_pins())) {
        if (gather) return std::make_unique<GatherEngine<Real>>(plan);
        return std::make_unique<EdgeEngine<Real>>(plan, true);
    }
    if (gather) return std::make_unique<SchemeEngine<Real, GatherEngine<Real>>>(plan);
    return std::make_unique<SchemeEngine<Real, EdgeEngine<Real>>>(plan);
}

}  // namespace

std::unique_ptr<Engine> make_engine(const Plan& plan) {
    return plan.precision == Precision::single ? make<float>(plan) : make<double>(plan);
}

}  // namespace clothsim
