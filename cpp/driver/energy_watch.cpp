#include "driver/energy_watch.hpp"

#include <algorithm>

namespace clothsim {

EnergyWatch::EnergyWatch(const Plan& plan) : plan_(plan) {
    const Cloth& cloth = plan.cloth;
    double all = 0;
    for (const Neighbour& n : neighbours)  // every spring from both ends, so half of half of k l^2
        if (cloth.present[n.family])
            all +=
                cloth.points() * cloth.stiffness[n.family] / 4 * cloth.rest_length(n) * cloth.rest_length(n);
    negligible_ = negligible_part * all;
}

Energy EnergyWatch::energy_of(const Engine& engine) {
    x_.resize(plan_.cloth.points(), 3);
    v_.resize(plan_.cloth.points(), 3);
    engine.store(x_.data(), v_.data());
    return energy(plan_, PointsView(x_.data(), x_.rows(), 3), PointsView(v_.data(), v_.rows(), 3));
}

void EnergyWatch::begin(const Engine& engine) {
    if (plan_.has_driven_pins()) return;
    if (std::exchange(started_, true)) return;
    start_ = energy_of(engine).total();
}

void EnergyWatch::change_force(const Engine& engine, const std::function<void()>& change) {
    const double before = started_ ? energy_of(engine).total() : 0;
    change();
    if (started_) start_ += energy_of(engine).total() - before;
}

std::int64_t EnergyWatch::runaway_point(Engine& engine, bool record) {
    if (!started_ || engine.watched.in_contact()) return -1;
    const Energy now = energy_of(engine);
    const double made = now.total() - start_, moving = now.kinetic + now.elastic;
    if (record) {
        engine.watched.energy_gained = std::max(engine.watched.energy_gained, made);
        if (made > negligible_ && made > grown_part * moving && !std::exchange(grown_, true)) news_ = true;
    }
    if (!(made > negligible_ && made > runaway_part * moving)) return -1;
    Eigen::Index fastest = 0;
    v_.rowwise().squaredNorm().maxCoeff(&fastest);
    return fastest;
}

}  // namespace clothsim
