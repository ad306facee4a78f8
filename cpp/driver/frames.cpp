#include "driver/frames.hpp"

#include <algorithm>
#include <cmath>

#include "driver/simulation.hpp"
#include "memory/poll.hpp"

namespace clothsim {
namespace {

constexpr double rounding_of_times = 4e-16;  // of a time over the step, as part of it

// Return where frame k begins in each array.
std::vector<double*> frame_pointers(const std::vector<double*>& arrays, std::size_t k,
                                    std::size_t size) {
    std::vector<double*> frame;
    for (double* const array : arrays) frame.push_back(array ? array + k * size : nullptr);
    return frame;
}

std::vector<double*> pointers(std::vector<std::vector<double>>& states) {
    std::vector<double*> first;
    for (std::vector<double>& state : states) first.push_back(state.data());
    return first;
}

// Lift a point in an obstacle to its lesser height at both ends, or to the contact surface where
// that is lower.
void lift(const Scene& scene, const Sphere& sphere, double t, const StepEnds& ends, double* x) {
    const Surface begin = sphere.surface_at(ends.begin);
    const Surface now = sphere.surface_at(t);
    const Surface end = sphere.surface_at(ends.begin + ends.length);
    const auto height = [](const Surface& surface, const Vec3& place) {
        return surface.height(surface.level(place - surface.place));
    };
    for (int p = 0; p < scene.cloth.points(); ++p) {
        if (scene.cloth.pinned[std::size_t(p)]) continue;
        Eigen::Map<Vec3> place(x + 3 * p);
        const Vec3 d = place - now.place;
        const double present = now.height(now.level(d));
        const double allowed = std::min({height(begin, Vec3(ends.x0 + 3 * p)),
                                         height(end, Vec3(ends.x1 + 3 * p)), sphere.offset});
        const Vec3 gradient = now.gradient(d);
        const double length = gradient.norm();
        if (present < allowed && length > 0) place += (allowed - present) / length * gradient;
    }
}

// The cloths of the core.
class CoreCloths : public Cloths {
public:
    CoreCloths(Simulation& simulation, int threads, const std::function<bool()>& interrupted)
        : simulation_(simulation), threads_(threads), interrupted_(interrupted) {}

    std::size_t size() const override { return simulation_.size(); }
    bool moves(std::size_t i) const override { return !simulation_.frozen(i); }
    const Scene& scene(std::size_t i) const override { return simulation_.plan(i); }
    double now() const override { return simulation_.clock.now(); }
    Outcome advance(std::int64_t steps, double dt) override {
        return simulation_.advance(steps, dt, threads_, interrupted_);
    }
    bool interrupted() override { return interrupted_(); }
    void sample() override { simulation_.sample(); }
    void store(const std::vector<double*>& x, const std::vector<double*>& v) override {
        for (std::size_t i = 0; i < x.size(); ++i)
            if (x[i]) simulation_.member(i).store(x[i], v[i]);
    }

private:
    Simulation& simulation_;
    int threads_;
    const std::function<bool()>& interrupted_;
};

}  // namespace

Outcome Simulation::record(FixedRun& run, const FrameArrays& arrays, std::int64_t most_steps,
                           std::size_t most_frames, int threads,
                           const std::function<bool()>& interrupted) {
    CoreCloths cloths(*this, threads, interrupted);
    return run.record(cloths, arrays, most_steps, most_frames);
}

void interpolate(const Scene& scene, double t, const StepEnds& ends, double* x, double* v) {
    const double h = ends.length;
    const double s = (t - ends.begin) / h;
    for (std::int64_t k = 0; k < 3 * std::int64_t(scene.cloth.points()); ++k) {
        const double x0 = ends.x0[k];
        const double x1 = ends.x1[k];
        const double v0 = ends.v0[k];
        const double v1 = ends.v1[k];
        x[k] = x0 +
            s *
                (h * v0 +
                 s * (3 * (x1 - x0) - h * (2 * v0 + v1) + s * (2 * (x0 - x1) + h * (v0 + v1))));
        v[k] = v0 +
            s * (6 * (x1 - x0) / h - 2 * (2 * v0 + v1) + 3 * s * (2 * (x0 - x1) / h + v0 + v1));
    }
    scene.each_driven_pin(StageTime::at_rest(t), 0, scene.cloth.points(),
                          [&](int point, const Vec3& place, const Vec3& velocity) {
                              Eigen::Map<Vec3>(x + 3 * point) = place;
                              Eigen::Map<Vec3>(v + 3 * point) = velocity;
                          });
    for (const Sphere& sphere : scene.spheres)
        if (!sphere.penalty()) lift(scene, sphere, t, ends, x);
}

// Fixed steps

FixedRun::Place FixedRun::place_of_next_frame() const {
    const Segment& segment = segments_[segment_];
    const std::size_t number = frames.stored.size();
    const double seconds = frames.moments[number].seconds;
    const double near = heuristics::negligible_step * (segment.end.seconds - segment.begin.seconds);
    if (segment_ + 1 < segments_.size()) {
        if (seconds > segment.end.seconds + near) return {segment.steps(), false, false};
        if (seconds >= segment.end.seconds - near) return {segment.steps()};
    } else if (number + 1 == frames.moments.size()) {
        return {segment.steps()};
    }
    const double steps_so_far = (seconds - segment.begin.seconds) / segment.dt;
    const double rounding = heuristics::negligible_step + steps_so_far * rounding_of_times;
    const std::int64_t steps = std::int64_t(std::floor(steps_so_far + rounding));
    return {steps, steps_so_far - double(steps) > rounding};
}

bool FixedRun::advance_to(std::int64_t steps, Cloths& cloths, Outcome& outcome,
                          std::int64_t& budget) {
    const Segment& segment = segments_[segment_];
    const auto count = [&](std::int64_t n) {
        done_ += n;
        steps_ += n;
        budget -= n;
    };
    while (done_ < steps) {
        if (budget <= 0) return false;
        const bool whole = done_ < segment.whole;
        const std::int64_t n = whole ? std::min({steps, segment.whole, done_ + budget}) - done_ : 1;
        const double begin = cloths.now();
        dt_ = whole ? segment.dt : segment.rest;
        Outcome part;
        try {
            part = cloths.advance(n, dt_);
        } catch (...) {  // A user's force throws between two steps.
            count(std::llround((cloths.now() - begin) / dt_));
            throw;
        }
        count(part.steps);
        outcome.append(std::move(part));
        if (!outcome.complete()) return false;
    }
    return true;
}

Outcome FixedRun::record(Cloths& cloths, const FrameArrays& arrays, std::int64_t most_steps,
                         std::size_t most_frames) {
    Outcome outcome;
    const std::size_t size = 3 * std::size_t(cloths.scene(0).cloth.points());
    const std::size_t last = std::min(arrays.capacity, frames.stored.size() + most_frames);
    std::int64_t budget = most_steps;
    // Calls of `advance` may be too short to ask by themselves.
    const std::function<bool()> interrupted = [&] { return cloths.interrupted(); };
    Poll poll(interrupted);
    while (!complete() && frames.stored.size() < last) {
        const std::size_t number = frames.stored.size();
        const auto x = frame_pointers(arrays.x, number, size);
        const auto v = frame_pointers(arrays.v, number, size);
        // The run begins at the present state, whatever its clock has rounded.
        const Place place = number == 0 ? Place{} : place_of_next_frame();
        if (!place.within) {
            if (!advance_to(place.steps, cloths, outcome, budget)) return outcome;
        } else if (step_of_ends_ != place.steps) {
            const auto keep = [&](auto& xs, auto& vs) {
                xs.assign(cloths.size(), std::vector<double>(size));
                vs.assign(cloths.size(), std::vector<double>(size));
                cloths.store(pointers(xs), pointers(vs));
            };
            if (!advance_to(place.steps, cloths, outcome, budget)) return outcome;
            keep(x0_, v0_);
            if (!advance_to(place.steps + 1, cloths, outcome, budget)) return outcome;
            keep(x1_, v1_);
            step_of_ends_ = place.steps;
        }
        if (!place.stores) {
            ++segment_;
            done_ = 0;
            step_of_ends_ = -1;
            continue;
        }
        const Moment& moment = frames.moments[number];
        if (place.within) {
            const Segment& segment = segments_[segment_];
            StepEnds ends;
            ends.begin = segment.begin.time + double(place.steps) * segment.dt;
            ends.length = place.steps < segment.whole ? segment.dt : segment.rest;
            for (std::size_t i = 0; i < cloths.size(); ++i) {
                if (!cloths.moves(i)) continue;
                ends.x0 = x0_[i].data();
                ends.v0 = v0_[i].data();
                ends.x1 = x1_[i].data();
                ends.v1 = v1_[i].data();
                interpolate(cloths.scene(i), moment.time, ends, x[i], v[i]);
            }
        } else {
            cloths.sample();
            cloths.store(x, v);
        }
        frames.step = place.within ? -1 : steps_;
        frames.stored.push_back(moment);
        outcome.interrupted = poll.stopped();
        if (outcome.interrupted) return outcome;
    }
    return outcome;
}

}  // namespace clothsim
