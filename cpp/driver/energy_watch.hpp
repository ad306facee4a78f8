// The watch over the energy of a run, which no step may make of nothing.
#pragma once

#include <functional>
#include <utility>

#include "engines/engine.hpp"
#include "measure/diagnostics.hpp"

namespace clothsim {

// Nothing adds to the total energy of a cloth but the work of moving obstacles and of forces such
// as wind, which the engine sums up, and an unstable step. Responses after a step change the
// energy, so that the watch ends with the first of them. A step may be unstable above the stability
// limit, and below the guaranteed limit at states outside the guarantee. The cloth need not fly
// apart: waves may grow until it has folded into a shape that stops them.
//
// Driven pins do work of any size, so that a cloth with some is not watched.
class EnergyWatch {
public:
    explicit EnergyWatch(const Plan& plan);

    void restart() { started_ = grown_ = false; }
    // Begin to watch at the present state, unless the run has begun. Return whether it begins now.
    bool begin(const Engine& engine, double t);
    bool begun() const { return started_; }
    // Another force on points or another place of an obstacle gives a state another energy, which
    // no step has made.
    void change_scene(const Engine& engine, double t, const std::function<void()>& change);

    // Steps of `dt` follow. Within the guaranteed time step a splitting method keeps an energy of
    // its own, and the true energy swings beside it: see energy_swing. Only more than that swing is
    // judged, at states for which the guarantee holds.
    void set_step(double dt, double stable_dt);

    // Parts of the kinetic and elastic energy made of nothing that are a warning, and an error. At
    // half of either, harmless errors of a long step are judged; above 1 nothing is.
    static constexpr double grown_part = 0.5, runaway_part = 0.9;
    // The part of the energy of all springs at twice their rest lengths that counts as nothing: a
    // stretch of a thousandth. An unstable energy doubles within steps, so half or twice the part
    // changes little.
    static constexpr double negligible_part = 1e-6;

    // Return the fastest free mass point if the energy has run away, else -1. With `record` the
    // gain goes into engine.watched.
    std::int64_t runaway_point(Engine& engine, double t, bool record);
    // Return -1 if all are pinned.
    std::int64_t fastest_free_point(const Engine& engine);
    // Return whether energy has grown out of nothing at a recorded inspection; true once.
    bool take_news_of_growth() { return std::exchange(news_, false); }

private:
    // Return the energy less the work of obstacles and forces so far.
    double balance(const Engine& engine, const Energy& energy) const;
    Energy energy_of(const Engine& engine, double t);
    // Return whether the guarantee of the time step holds at the state of the last energy
    // (docs/stability.md). No spring is shorter than half its rest length, and none turns too fast
    // for its damping.
    bool guaranteed() const;
    // Return whether the method's own swing reaches what is judged.
    bool swings() const { return swing_ > grown_part; }
    // Return whether a gain is more than this part of the moving energy, and more than the method's
    // own swing.
    bool exceeds(double part, double gain, double moving) const;

    const Plan& plan_;
    double negligible_;  // J, to stretch every spring by a thousandth
    double start_ = 0;   // J
    double swing_ = 0;   // the part that the method itself may make, see set_step
    bool started_ = false, grown_ = false, news_ = false;
    bool guaranteed_ = false;  // the guarantee held at every inspected state of the run
    Points x_, v_;
};

// Above its guaranteed stable time step a cloth may still be well; a point that crosses the whole
// sheet within a step is not. Return the speed of such a point [m/s], infinite for a time step
// within the guarantee.
double runaway_speed(const Cloth& cloth, double dt, double stable_dt);

}  // namespace clothsim
