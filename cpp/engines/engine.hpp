// One cloth's state inside the core, and the loop that advances it.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "contact/contact_report.hpp"
#include "integrators/adaptive.hpp"
#include "measure/impulses.hpp"
#include "measure/watched.hpp"
#include "memory/plan.hpp"
#include "model/clock.hpp"

namespace clothsim {

// Extents of a cloth from the origin to its middle, from which on single keeps positions relative to there.
inline constexpr double extents_that_are_far = 8;

// The whole state of a cloth between steps: from it, an engine of any layout continues bit for bit.
struct SavedState {
    // Of shape (rows, columns, 3) in C order: positions relative to the origin [m], velocities [m/s]. In
    // single the low parts are what compensation adds to them; in double they are empty.
    std::vector<double> x, v, x_low, v_low;
    Vec3 origin = Vec3::Zero();  // m
    std::vector<double> impulses;  // of Impulses [N s]
};

// Three components of all points from the first on (x, y, z, vx, vy, vz), or what compensation adds to them.
struct SavedPart {
    bool low;
    int first;
    std::vector<double> SavedState::* values;
};
inline std::span<const SavedPart> saved_parts(bool compensated) {
    static constexpr SavedPart all[]{{false, 0, &SavedState::x},
                                     {false, 3, &SavedState::v},
                                     {true, 0, &SavedState::x_low},
                                     {true, 3, &SavedState::v_low}};
    return {all, compensated ? 4u : 2u};
}

// Counts and extremes over the states so far. A checkpoint holds a copy, so that steps which are taken back
// leave no trace.
struct Tally {
    Shared<std::int64_t> contact_responses{0};  // of the spheres to mass points
    Watched watched;  // depths only when asked for; the first contact always
    Impulses impulses;  // of all responses
};

class Engine : public Tally {
public:
    virtual ~Engine() = default;

    // As `advance`, with a contact pass after each step. `behind_planes`: steps that are expected to be
    // clear of the spheres may skip the pass (contact/separating_planes.hpp). False if a step was not clear;
    // the state must then be discarded.
    bool advance_in_contact(std::int64_t steps, const Clock& clock, int threads, bool behind_planes);

    // Of the passes since the last inspection, see ContactReport.
    ContactReport contact_report;

    // Looks for a cell that is larger than a sphere and touches it, if the contact pass has run since the
    // last look.
    virtual void note_large_cells(double t) = 0;
    // Raises the depth of mass points by that of all points of the present state, at time t.
    virtual void note_all_depths(double t) = 0;

    // Relative, of the arrays that a call has brought, until its first pass of contacts. In coarse arrays a
    // point that lay on a sphere may lie in it.
    double rounding_of_arrays = 0;
    int threads = 1;  // that the newest steps might use, and copies of the state may too

    // Arrays of shape (rows, columns, 3), C order; whether all their numbers are finite in this precision.
    // Velocities of held pins are taken as 0. A null array is not stored.
    virtual bool load(const float* x, const float* v) = 0;
    virtual bool load(const double* x, const double* v) = 0;
    virtual void store(float* x, float* v) const = 0;
    virtual void store(double* x, double* v) const = 0;

    // Steps k = 1..steps of the clock without contacts.
    virtual void advance(std::int64_t steps, const Clock& clock, int threads) = 0;
    virtual void accelerations(double* a, int threads) = 0;

    // Counts begin again, before another state is loaded.
    void begin_anew() {
        contact_responses = 0;
        evaluations = 0;
        contact_report = {};
        watched = {};
        impulses.begin_anew();
    }

    // Put driven pins to their places, with their velocities, of a time; a new state leaves that to the
    // caller.
    virtual void place_pins(double t) = 0;

    // A sphere's centre and motion from now on; the state stays.
    virtual void set_sphere(std::size_t sphere, const Vec3& center, const Motion& motion) = 0;

    // The force on each mass point from now on [N], shape (rows, columns, 3).
    virtual void set_force(const double* force) = 0;

    // Index of the first mass point whose state is not finite, or -1; a pin only where every free point is
    // good. A free point counts too whose velocity differs from the mean velocity by more than `speed_limit`
    // [m/s].
    virtual std::int64_t first_bad_point(double speed_limit) const = 0;

    // The whole state; an engine of another layout or scene may continue it. The numbers of values must be
    // those of this cloth and precision. Velocities of held pins are taken as 0.
    virtual SavedState saved_state() const = 0;
    virtual void set_saved_state(const SavedState& state) = 0;

    // A copy that the engine keeps, with its counts and extremes; see driver/simulation.hpp.
    virtual void save_checkpoint() = 0;
    virtual void restore_checkpoint() = 0;

    // Force evaluations so far, of the integrators in cpp/integrators; the fused RK4 takes four a step.
    std::int64_t evaluations = 0;
    // Not null: the integrator carries an error estimate.
    virtual AdaptiveEngine* adaptive() { return nullptr; }
    // Take the step that `adaptive()` has tried, from t0 to t1, with the contact pass at its end.
    // Where the spheres leave a point no place (contact_report), the state is that at t0.
    void accept_in_contact(double t0, double t1, int threads);
    // Whether there are spheres.
    virtual bool has_contacts() const = 0;

protected:
    // Steps of so many that are expected to be clear of the spheres; whether they were.
    virtual std::int64_t clear_steps(const Clock& clock, std::int64_t most) = 0;
    virtual bool advance_behind_planes(std::int64_t steps, const Clock& clock, int threads) = 0;
    // Before a step that may not be; after it.
    virtual void keep_state() = 0;
    void respond(double t0, double t1, double dt, int threads);
    virtual ContactReport respond_to_contacts(double t0, double t1, double dt, int threads) = 0;
};

// Above its guaranteed stable time step a cloth may still be well; a point that crosses the whole sheet
// within a step is not. Infinite for a time step within the guarantee [m/s].
double runaway_speed(const Cloth& cloth, double dt, double stable_dt);

std::unique_ptr<Engine> make_engine(const Plan& plan);

}  // namespace clothsim
