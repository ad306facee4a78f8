// Frames of a run: the states at given times, which the core writes into arrays of the caller.
//
//     |---------|---------|---------|---------|    steps of a run
//     f         f      f       f              f    frames
//
// The run takes the steps that it takes without frames. A frame at the end of a step is the state
// there; another one is interpolated between the states at both ends of its step.
#pragma once

#include <cstdint>
#include <vector>

#include "model/scene.hpp"

namespace clothsim {

struct Outcome;

// The states of a cloth at both ends of a step.
struct StepEnds {
    double begin = 0, length = 0;  // s
    const double *x0 = nullptr, *v0 = nullptr;  // m, m/s
    const double *x1 = nullptr, *v1 = nullptr;
};

// Write the state at a time t within a step. Positions are the cubic Hermite polynomial of both
// ends, of order 4 in the time step where nothing responds after it; velocities are its derivative,
// of order 3. Driven pins are where their motion has them. Free points are no deeper in an obstacle
// of the paper's responses than at the deeper of both ends.
void interpolate(const Scene& scene, double t, const StepEnds& ends, double* x, double* v);

struct Moment {
    double seconds = 0;  // since the start of the run
    double time = 0;  // of the scene [s]
};

// The frames that are asked for, and those so far.
struct Frames {
    std::vector<Moment> moments;  // rising; the first is the beginning of the run, the last its end
    std::vector<Moment> stored;
    std::int64_t step = -1;  // of the run, at whose end the last frame lies; -1: within a step
};

// Where frames go: arrays (frames, points, 3) of the positions [m] and the velocities [m/s] of each
// member, with room for `capacity` frames.
struct FrameArrays {
    std::vector<double*> x, v;
    std::size_t capacity = 0;
};

// Equal steps of `dt`, and then a shorter one where `rest` is above 0.
struct Segment {
    Moment begin, end;
    double dt = 0;  // s
    std::int64_t whole = 0;
    double rest = 0;  // s

    std::int64_t steps() const { return whole + (rest > 0); }
};

// What takes fixed steps: the core's simulation, or that of the graphics adapter.
class Cloths {
public:
    virtual ~Cloths() = default;
    virtual std::size_t size() const = 0;
    virtual bool moves(std::size_t i) const = 0;  // false for a frozen member
    virtual const Scene& scene(std::size_t i) const = 0;
    virtual double now() const = 0;
    virtual Outcome advance(std::int64_t steps, double dt) = 0;
    virtual void sample() = 0;
    virtual bool interrupted() = 0;  // by Ctrl-C
    // Write the states of all members, for each of which there is a pointer.
    virtual void store(const std::vector<double*>& x, const std::vector<double*>& v) = 0;
};

// A run in progress: its steps and its frames.
class RunInProgress {
public:
    virtual ~RunInProgress() = default;
    virtual std::int64_t steps() const = 0;  // so far
    virtual double dt() const = 0;  // of the last step, or the next one to try [s]
    virtual bool complete() const = 0;
    // Return whether the present state comes after the last frame.
    bool ahead() const { return frames.step != steps(); }

    Frames frames;
};

// A run with fixed steps.
class FixedRun : public RunInProgress {
public:
    FixedRun(std::vector<Segment> segments, std::vector<Moment> moments)
        : segments_(std::move(segments)), dt_(segments_.front().dt) {
        frames.moments = std::move(moments);
    }

    // Take steps and store frames: at most so many of either in this call. It ends sooner at an
    // event, which the caller has to report before he goes on.
    Outcome record(Cloths& cloths, const FrameArrays& arrays, std::int64_t most_steps,
                   std::size_t most_frames);

    std::int64_t steps() const override { return steps_; }
    double dt() const override { return dt_; }
    bool complete() const override { return frames.stored.size() == frames.moments.size(); }

private:
    // The next frame follows after `steps` steps of the segment, or `within` the step after these.
    struct Place {
        std::int64_t steps = 0;
        bool within = false;
        bool stores = true;  // false: no further frame lies in the segment
    };
    Place place_of_next_frame() const;
    // Take steps until `steps` of the segment are done. Return false if the call ends before.
    bool advance_to(std::int64_t steps, Cloths& cloths, Outcome& outcome, std::int64_t& budget);

    std::vector<Segment> segments_;
    std::size_t segment_ = 0;
    std::int64_t done_ = 0;  // steps of the segment
    std::int64_t steps_ = 0;
    double dt_;
    // The step between whose ends frames are interpolated, and the states of all members there.
    std::int64_t step_of_ends_ = -1;
    std::vector<std::vector<double>> x0_, v0_, x1_, v1_;
};

}  // namespace clothsim
