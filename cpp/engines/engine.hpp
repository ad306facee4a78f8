// One cloth's state inside the core, and the loop that advances it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "forces/contact_sums.hpp"
#include "forces/contacts.hpp"
#include "integrators/adaptive.hpp"
#include "measure/impulses.hpp"
#include "memory/plan.hpp"
#include "model/clock.hpp"

namespace clothsim {

// The whole state of a cloth between steps, to be continued bit for bit.
struct SavedState {
    // The values have the shape (parts, rows, columns, 3): positions relative to the origin [m],
    // velocities [m/s]; in single there are two more parts, what compensation adds to each.
    std::vector<double> values;
    Vec3 origin = Vec3::Zero();  // m
    std::vector<double> impulses;  // of Impulses [N s]
    std::vector<double> contacts;  // of Tally
    std::vector<Vec3> normals;  // of the surface points from which gaps are measured, in single
};

// Extremes over the states of a run: the initial one, and each at the end of a step.
struct Watched {
    // End of the first step that a response changed [s].
    double first_contact = std::numeric_limits<double>::infinity();
    double point_depth = 0;  // of mass points below a sphere's surface, every step [m]
    double triangle_depth = 0;           // of triangles, at the states sampled [m]
    double stretch = -std::numeric_limits<double>::infinity();  // at the states sampled
    // Most that the total was above that of the start, where it is watched [J].
    double energy_gained = 0;

    bool responded = false;  // whether an obstacle did that is no part of the equation

    bool in_contact() const { return first_contact < std::numeric_limits<double>::infinity(); }
};

// Counts and extremes over the states so far. A checkpoint holds a copy, so that steps which are
// taken back leave no trace.
struct Tally {
    std::int64_t contact_responses = 0;  // of the spheres to mass points
    Watched watched;  // depths only when asked for; the first contact always
    Impulses impulses;  // of all responses
    ContactTally contacts;  // of obstacles with the response "penalty"
    std::vector<double> work_rows;  // of the forces in `works`, by force and row [J]
};

class Engine : public Tally {
public:
    virtual ~Engine() = default;

    // Take the steps of `advance`, with the paper's responses after each.
    virtual void advance_and_respond(std::int64_t steps, const Clock& clock, int threads) = 0;

    int threads = 1;  // number that the newest steps might use, and copies of the state may too

    // Load and store arrays of shape (rows, columns, 3), C order, of time t [s]. `load` returns
    // whether all their numbers are finite in this precision. Velocities of held pins are taken as
    // 0. A null array is not stored.
    virtual bool load(double t, const float* x, const float* v) = 0;
    virtual bool load(double t, const double* x, const double* v) = 0;
    virtual void store(float* x, float* v) const = 0;
    virtual void store(double* x, double* v) const = 0;

    // Take steps k = 1..steps of the clock without contacts.
    virtual void advance(std::int64_t steps, const Clock& clock, int threads) = 0;
    // Write the accelerations at the time t.
    virtual void accelerations(double t, double* a) = 0;

    // Counts begin again, before another state is loaded.
    void clear_counts() {
        contact_responses = 0;
        evaluations = 0;
        watched = {};
        impulses.clear_counts();
        contacts.clear();
        std::fill(work_rows.begin(), work_rows.end(), 0.0);
    }
    // Return the deepest free points in the layers of penalty obstacles at the time t, for each
    // obstacle.
    virtual std::vector<Depth> depths(double t) const = 0;
    // Return a pinned point below the true surface of a penalty obstacle at the time t, or -1.
    virtual int pinned_point_below(double t) const = 0;
    // Return a speed above that of every point [m/s].
    virtual double speed_bound() const = 0;
    // Note what the steps so far have met in `watched`.
    virtual void note_contacts() = 0;

    // Work on the free mass points so far, of each force that the kernels do not compute [J].
    struct Work {
        std::string force;
        double work;
    };
    virtual std::vector<Work> works_of_forces() const = 0;
    // The exception that a force has thrown; from then on accelerations are NaN, until it is taken
    // away.
    std::exception_ptr force_failure;

    // Put driven pins to their places, with their velocities; a new state leaves that to the
    // caller.
    virtual void place_pins(double t) = 0;

    // Return what the engine computes, with the changes of `set_sphere` and `set_force`.
    virtual const Plan& plan() const = 0;

    // Set a sphere's centre and motion from now on; the state stays.
    virtual void set_sphere(std::size_t sphere, const Vec3& center, const Motion& motion) = 0;

    // Set the force on each mass point from now on [N], shape (rows, columns, 3).
    virtual void set_force(const double* force) = 0;

    // Return the index of the first mass point whose state is not finite, or -1; a pin only where
    // every free point is good. A free point counts too whose velocity differs from the mean
    // velocity by more than `speed_limit` [m/s].
    virtual std::int64_t first_bad_point(double speed_limit) const = 0;

    // Return the state. An engine of another layout or scene of this shape and precision may
    // continue it.
    virtual SavedState saved_state() const = 0;
    // Continue a state of the time t. Without normals they are chosen anew.
    virtual void set_saved_state(const SavedState& state, double t) = 0;

    // Make, and go back to, a copy that the engine keeps, with its counts and extremes; see
    // driver/simulation.hpp.
    virtual void save_checkpoint() = 0;
    virtual void restore_checkpoint() = 0;

    // Force evaluations so far of the integrators in cpp/integrators; the fused RK4 takes four a
    // step.
    std::int64_t evaluations = 0;
    // Return the part that carries an error estimate, or null.
    virtual AdaptiveEngine* adaptive() { return nullptr; }
    // Take the step that `adaptive()` has tried, from t0 to t1, with the paper's responses at its
    // end.
    virtual void accept_and_respond(double t0, double t1, int threads) = 0;
    // Return whether there are obstacles that respond after a step, and obstacles of response
    // "penalty".
    virtual bool has_responses() const = 0;
    virtual bool has_penalty() const = 0;
};

std::unique_ptr<Engine> make_engine(const Plan& plan);

}  // namespace clothsim
