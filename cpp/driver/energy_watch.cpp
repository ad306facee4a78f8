#include "driver/energy_watch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "integrators/methods.hpp"
#include "measure/diagnostics.hpp"

namespace clothsim {

EnergyWatch::EnergyWatch(const Plan& plan) : plan_(plan) {
    const Cloth& cloth = plan.cloth;
    double all = 0;
    for (const Neighbour& n : neighbours)  // every spring from both ends, so half of half of k l^2
        if (cloth.present[n.family])
            all += cloth.points() * cloth.stiffness[n.family] / 4 * cloth.rest_length(n) *
                cloth.rest_length(n);
    negligible_ = negligible_part * all;
}

Energy EnergyWatch::energy_of(const Engine& engine, double t) {
    x_.resize(plan_.cloth.points(), 3);
    v_.resize(plan_.cloth.points(), 3);
    engine.store(x_.data(), v_.data());
    const Energy now =
        energy(plan_, PointsView(x_.data(), x_.rows(), 3), PointsView(v_.data(), v_.rows(), 3), t);
    return now;
}

double EnergyWatch::balance(const Engine& engine, const Energy& energy) const {
    double work = 0;
    for (std::size_t s = 0; s < plan_.spheres.size(); ++s)
        if (plan_.spheres[s].penalty()) work += engine.contacts.of(s).work;
    for (const Engine::Work& of_force : engine.works_of_forces()) work += of_force.work;
    return energy.total() - work;
}

bool EnergyWatch::begin(const Engine& engine, double t) {
    if (plan_.has_driven_pins() || std::exchange(started_, true)) return false;
    start_ = balance(engine, energy_of(engine, t));
    guaranteed_ = swings() && guaranteed();
    return true;
}

void EnergyWatch::change_scene(const Engine& engine, double t,
                               const std::function<void()>& change) {
    const double start = started_ ? energy_of(engine, t).total() : 0;
    change();
    if (started_) start_ += energy_of(engine, t).total() - start;
}

void EnergyWatch::set_step(double dt, double stable_dt) {
    const Splitting* const splitting = method_of(plan_.integrator).splitting;
    const double swing = splitting && dt <= stable_dt
        ? energy_swing(*splitting, dt * std::sqrt(mode_bounds(plan_.cloth).stiffness))
        : 0;
    swing_ = swing + (1 - swing) / 10;  // modes of several frequencies add up
}

bool EnergyWatch::guaranteed() const {
    const Cloth& cloth = plan_.cloth;
    bool all = true;
    cloth.each_spring([&](int i, int j, const Neighbour& n) {
        const Vec3 along = x_.row(j) - x_.row(i), speed = v_.row(j) - v_.row(i);
        const double length = along.norm();
        all &= 2 * length >= cloth.rest_length(n) &&
            cloth.spring_damping[n.family] * speed.norm() <= cloth.stiffness[n.family] * length;
    });
    return all;
}

bool EnergyWatch::exceeds(double part, double gain, double moving) const {
    if (!(gain > part * moving)) return false;
    return !(guaranteed_ && swing_ > part && gain <= swing_ * moving);
}

std::int64_t EnergyWatch::runaway_point(Engine& engine, double t, bool record) {
    if (!started_ || engine.watched.responded) return -1;
    const Energy now = energy_of(engine, t);
    const double gain = balance(engine, now) - start_;
    const double moving = now.kinetic + now.elastic + now.contact;
    guaranteed_ = guaranteed_ && swings() && guaranteed();
    if (record) {
        engine.watched.energy_gained = std::max(engine.watched.energy_gained, gain);
        if (gain > negligible_ && exceeds(grown_part, gain, moving) && !std::exchange(grown_, true))
            news_ = true;
    }
    return gain > negligible_ && exceeds(runaway_part, gain, moving) ? fastest_free_point(engine)
                                                                     : -1;
}

std::int64_t EnergyWatch::fastest_free_point(const Engine& engine) {
    v_.resize(plan_.cloth.points(), 3);
    engine.store(nullptr, v_.data());
    std::int64_t fastest = -1;
    for (int i = 0; i < plan_.cloth.points(); ++i)
        if (!plan_.cloth.pinned[std::size_t(i)] &&
            (fastest < 0 || v_.row(i).squaredNorm() > v_.row(fastest).squaredNorm()))
            fastest = i;
    return fastest;
}

double runaway_speed(const Cloth& cloth, double dt, double stable_dt) {
    if (dt <= stable_dt) return std::numeric_limits<double>::infinity();
    return std::hypot((cloth.rows - 1) * cloth.row_spacing,
                      (cloth.columns - 1) * cloth.column_spacing) /
        dt;
}

}  // namespace clothsim
