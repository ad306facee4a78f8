// Every integrator but the fused RK4 of the kernels, on top of an engine that can evaluate accelerations at any
// state: each thread has a band of rows and combines states and accelerations element by element.
//
// Stage by stage a thread writes its rows of the next stage state, waits for the others, and evaluates its rows of
// the acceleration, for which it reads two rows on either side. The stage states alternate between two arrays, so
// that one barrier a stage is enough: who writes one array knows that all others have left it, as they have passed the
// barrier of the stage between.
#pragma once

#include <omp.h>

#include <array>
#include <atomic>
#include <memory>

#include "dynamics/adaptive.hpp"
#include "dynamics/combine.hpp"
#include "dynamics/implicit.hpp"
#include "dynamics/methods.hpp"
#include "simulation/state_engine.hpp"

namespace clothsim {

template <class Real, class Base>
class SchemeEngine final : public Base, public AdaptiveEngine {
public:
    explicit SchemeEngine(const Plan& plan) : Base(plan), method_(method_of(plan.integrator)), field_(this->field()) {
        const Cloth& cloth = this->plan_.cloth;
        damped_ = cloth.point_damping > 0 || cloth.has_spring_damping();
        scheme_ = method_.scheme;
        explicit_ = method_.explicit_method;
        if (scheme_ == Scheme::verlet && damped_) {
            scheme_ = Scheme::explicit_rk;
            explicit_ = method_.damped;
        }
        if (scheme_ == Scheme::implicit_midpoint) {
            implicit_ = std::make_unique<ImplicitMidpoint>(this->plan_.cloth, this->plan_.gravity);
            return;
        }
        const bool adaptive = explicit_ && !explicit_->errors.empty();
        const int count = !explicit_ ? 1 : explicit_->stages + (adaptive ? 1 : 0);
        for (int i = 0; i < count; ++i) slot_.push_back(i);
        accelerations_.assign(std::size_t(field_.acceleration_size(count)), Real(0));
        // Copies of the engine's memory, for its padding.
        if (explicit_)
            for (auto& stage : stages_) stage = this->memory_;
        if (adaptive) result_ = previous_ = this->memory_;
        for (std::size_t e = 0; adaptive && e < explicit_->errors.size(); ++e)
            row_squares_.emplace_back(std::size_t(this->rows()));
    }

    void advance(std::int64_t steps, const Clock& clock, int threads) override {
        if (scheme_ == Scheme::implicit_midpoint) {
            for (std::int64_t k = 1; k <= steps; ++k) {
                advance_implicit(clock.dt);
                this->collide_all(clock.at(k));
            }
            return;
        }
        contact_[0] = contact_[1] = false;
        bool known_after = false;
        in_bands(threads, [&](const Band& band) {
            bool known = this->acceleration_known_;
            for (std::int64_t k = 1; k <= steps; ++k) {
                if (band.first) contact_[(k + 1) & 1] = false;
                switch (scheme_) {
                    case Scheme::splitting: advance_splitting(band, clock.dt); break;
                    case Scheme::verlet: advance_verlet(band, clock.dt, known); break;
                    default: advance_explicit(band, clock.dt); break;
                }
                const bool contact = collide(band, clock.at(k), contact_[k & 1]);
                known = scheme_ == Scheme::verlet && !contact;
                band.barrier();
            }
            if (band.first) known_after = known;
        });
        this->acceleration_known_ = known_after;
    }

    AdaptiveEngine* adaptive() override { return explicit_ && !explicit_->errors.empty() ? this : nullptr; }

    // Error control ------------------------------------------------------------------------------------------

    int order() const override { return explicit_->order; }

    double try_step(double h, const Tolerance& tolerance, int threads) override {
        const ExplicitMethod& m = *explicit_;
        in_bands(threads, [&](const Band& band) {
            if (!this->acceleration_known_) evaluate(band, this->memory_.data(), 0);
            run_stages(band, h, this->memory_);
            combine_band(band, this->memory_, result_, m.result, h);
            if (m.error_needs_end) {
                band.barrier();
                evaluate(band, result_.data(), m.stages);
            }
            for (std::size_t e = 0; e < m.errors.size(); ++e)
                square_rows(field_, band.begin, band.end, this->memory_.data(),
                            combination(m.errors[e], h, 1 / tolerance.x, 1 / tolerance.v), row_squares_[e].data());
        });
        this->acceleration_known_ = true;
        step_ = h;
        double squares[2] = {0, 0};
        for (std::size_t e = 0; e < m.errors.size(); ++e)
            for (const RowSquares& row : row_squares_[e]) squares[e] += row.x + row.v;
        const double points = this->plan_.cloth.points();
        if (m.errors.size() == 1) return std::sqrt(squares[0] / points);
        // dop853.f: the estimate of order 5, held down where that of order 3 is much larger.
        if (squares[0] == 0) return 0;
        return squares[0] / std::sqrt((squares[0] + 0.01 * squares[1]) * points);
    }

    bool accept_step(double t, int threads) override {
        previous_ = this->memory_;
        contact_[0] = false;
        in_bands(threads, [&](const Band& band) {
            advance_band(band, explicit_->result, step_);
            collide(band, t, contact_[0]);
        });
        // The acceleration at the end is the first one of the next step, unless a contact has changed the state since.
        if (explicit_->error_needs_end) std::swap(slot_[0], slot_[std::size_t(explicit_->stages)]);
        this->acceleration_known_ = explicit_->error_needs_end && !contact_[0];
        return contact_[0];
    }

    double contact_step(double t, double h, bool tried) override {
        double allowed = h;
        for (const Sphere& sphere : this->plan_.spheres) {
            const Vec3 center = sphere.center_at(t);
            const double least_gap = contact_fraction * sphere.contact_radius;
            // The sphere's own way may depend on the step; a shorter step is checked again by the caller.
            const Vec3 travel = (sphere.center_at(t + h) - center) / h;
            const double sphere_speed = std::max({(sphere.velocity_at(t) - travel).norm(),
                                                  (sphere.velocity_at(t + h) - travel).norm()});
            for (int r = 0; r < this->rows(); ++r)
                for (int c = 0; c < this->columns(); ++c) {
                    if (this->plan_.cloth.pinned[std::size_t(r * this->columns() + c)]) continue;
                    const PointState point = this->point_state(r, c);
                    double speed = (point.velocity - travel).norm();
                    if (tried) speed = std::max(speed, (vector_in(result_, r, c, 3) - travel).norm());
                    const double gap = (point.position - center).norm() - sphere.contact_radius;
                    const double way = (speed + sphere_speed) * allowed;
                    if (way > std::max(gap, least_gap)) allowed *= std::max(gap, least_gap) / way;
                }
        }
        return allowed;
    }

    bool step_touches(double t) override {
        for (const Contact& contact : this->contacts(t))
            for (int r = 0; r < this->rows(); ++r)
                for (int c = 0; c < this->columns(); ++c)
                    if (!this->plan_.cloth.pinned[std::size_t(r * this->columns() + c)] &&
                        touches(contact, vector_in(result_, r, c, 0)))
                        return true;
        return false;
    }

    void dense(double part, double* x, double* v, int threads) override {
        const ExplicitMethod& m = *explicit_;
        const bool interpolated = !m.dense_factors.empty();
        // The first and the last acceleration have changed places since the step.
        if (interpolated) std::swap(slot_[0], slot_[std::size_t(m.stages)]);
        in_bands(threads, [&](const Band& band) {
            if (!interpolated) run_stages(band, part * step_, previous_);
            combine_band(band, previous_, result_, interpolated ? m.dense(part) : m.result,
                         interpolated ? step_ : part * step_);
        });
        if (interpolated) std::swap(slot_[0], slot_[std::size_t(m.stages)]);
        for (int r = 0; r < this->rows(); ++r)
            for (int c = 0; c < this->columns(); ++c)
                for (int k = 0; k < 3; ++k) {
                    *x++ = double(result_[std::size_t(this->layout_.at(r, c, k))]);
                    *v++ = double(result_[std::size_t(this->layout_.at(r, c, 3 + k))]);
                }
    }

private:
    static constexpr int fewest_rows = 8;  // of a band

    struct Band {
        int begin, end;
        bool first, alone;
        FieldScratch<Real>* scratch;
        void barrier() const {
            if (alone) return;
#pragma omp barrier
        }
    };

    template <class Work>
    void in_bands(int threads, Work work) {
        const int rows = this->rows();
        const int team = this->track_contact_energy ? 1 : std::max(1, std::min(threads, rows / fewest_rows));
        if (scratch_.size() < std::size_t(team)) scratch_.resize(std::size_t(team));
        if (team == 1) {
            work(Band{0, rows, true, true, &scratch_[0]});
            return;
        }
#pragma omp parallel num_threads(team)
        {
            const int n = omp_get_num_threads(), t = omp_get_thread_num();
            work(Band{int(std::int64_t(rows) * t / n), int(std::int64_t(rows) * (t + 1) / n), t == 0, n == 1,
                      &scratch_[std::size_t(t)]});
        }
    }

    Real* acceleration(int index) {
        return accelerations_.data() + field_.acceleration(slot_[std::size_t(index)]);
    }
    void evaluate(const Band& band, const Real* state, int index) {
        Base::evaluate(state, acceleration(index), band.begin, band.end, *band.scratch);
        if (band.first) ++this->evaluations;
    }
    Combination<Real> combination(const Weights& w, double h, double scale_x = 1, double scale_v = 1) {
        Combination<Real> sum;
        sum.drift = Real(w.drift * h);
        for (std::size_t l = 0; l < w.v.size(); ++l)
            if (w.x[l] != 0 || w.v[l] != 0)
                sum.add(acceleration(int(l)), w.x[l] * h * h * scale_x, w.v[l] * h * scale_v);
        return sum;
    }
    void combine_band(const Band& band, const AlignedVector<Real>& from, AlignedVector<Real>& to, const Weights& w,
                      double h) {
        combine(field_, band.begin, band.end, from.data(), to.data(), combination(w, h));
    }
    void advance_band(const Band& band, const Weights& w, double h) {
        advance_rows(field_, band.begin, band.end, this->memory_.data(), combination(w, h));
    }
    void kick_drift(const Band& band, double drift, double kick, double kick_in_x) {
        Combination<Real> sum;
        sum.drift = Real(drift);
        sum.add(acceleration(0), kick_in_x, kick);
        advance_rows(field_, band.begin, band.end, this->memory_.data(), sum);
    }

    // The stages from the second on, from `state` whose acceleration is known.
    void run_stages(const Band& band, double h, const AlignedVector<Real>& state) {
        for (int s = 1; s < explicit_->stages; ++s) {
            AlignedVector<Real>& stage = stages_[s & 1];
            combine_band(band, state, stage, explicit_->stage[std::size_t(s)], h);
            band.barrier();
            evaluate(band, stage.data(), s);
        }
    }
    void advance_explicit(const Band& band, double h) {
        evaluate(band, this->memory_.data(), 0);
        run_stages(band, h, this->memory_);
        advance_band(band, explicit_->result, h);
    }
    void advance_splitting(const Band& band, double h) {
        const Splitting& s = *method_.splitting;
        if (s.drifts[0] != 0) {
            kick_drift(band, s.drifts[0] * h, 0, 0);
            band.barrier();
        }
        for (std::size_t i = 0; i < s.kicks.size(); ++i) {
            if (i > 0) band.barrier();
            evaluate(band, this->memory_.data(), 0);
            band.barrier();
            kick_drift(band, s.drifts[i + 1] * h, s.kicks[i] * h, s.drifts[i + 1] * s.kicks[i] * h * h);
        }
    }
    void advance_verlet(const Band& band, double h, bool known) {
        if (!known) {
            evaluate(band, this->memory_.data(), 0);
            band.barrier();
        }
        kick_drift(band, h, h / 2, h * h / 2);
        band.barrier();
        evaluate(band, this->memory_.data(), 0);
        band.barrier();
        kick_drift(band, 0, h / 2, 0);
    }
    void advance_implicit(double h) {
        Points x(this->plan_.cloth.points(), 3), v(this->plan_.cloth.points(), 3);
        this->store(x.data(), v.data());
        this->evaluations += implicit_->step(x, v, h);
        this->load(x.data(), v.data());
    }

    // The collision pass over the band; whether any point of the cloth was found inside, the same for all threads.
    bool collide(const Band& band, double t, std::atomic<bool>& found) {
        if (this->plan_.spheres.empty()) return false;
        if (this->track_contact_energy) {
            this->collide_all(t);
            return true;
        }
        if (this->collide_rows(band.begin, band.end, this->contacts(t))) found = true;
        band.barrier();
        return found;
    }

    // Components from `first` on: 0, the position, or 3, the velocity.
    Vec3 vector_in(const AlignedVector<Real>& state, int r, int c, int first) const {
        Vec3 value;
        for (int k = 0; k < 3; ++k) value[k] = double(state[std::size_t(this->layout_.at(r, c, first + k))]);
        return value;
    }

    const Method& method_;
    Scheme scheme_;
    const ExplicitMethod* explicit_;
    FieldLayout field_;
    bool damped_;
    std::unique_ptr<ImplicitMidpoint> implicit_;
    AlignedVector<Real> accelerations_;
    std::vector<int> slot_;  // where the acceleration of a stage lies
    std::array<AlignedVector<Real>, 2> stages_;
    std::vector<FieldScratch<Real>> scratch_;  // of the threads
    std::array<std::atomic<bool>, 2> contact_{};

    AlignedVector<Real> result_, previous_;  // of the step tried, and before the step accepted
    std::vector<std::vector<RowSquares>> row_squares_;
    double step_ = 0;
};

}  // namespace clothsim
