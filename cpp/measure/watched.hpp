// Extremes over the states of a run: the initial one, and each at the end of a step.
#pragma once

#include <atomic>
#include <cmath>
#include <limits>

namespace clothsim {

// Threads of a step lower or raise a value together; the order does not change the result.
inline void lower(std::atomic<double>& least, double value) {
    double now = least.load(std::memory_order_relaxed);
    while (value < now && !least.compare_exchange_weak(now, value, std::memory_order_relaxed)) {
    }
}
inline void raise(std::atomic<double>& most, double value) {
    double now = most.load(std::memory_order_relaxed);
    while (value > now && !most.compare_exchange_weak(now, value, std::memory_order_relaxed)) {
    }
}

// A checkpoint holds a copy, so that steps which are taken back leave no trace.
struct Watched {
    std::atomic<double> first_contact{
        std::numeric_limits<double>::infinity()};  // end of the first step that a response changed [s]
    std::atomic<double> point_depth{0};  // of mass points below a sphere's true radius, every step [m]
    double triangle_depth = 0;           // of triangles, at the states sampled [m]
    double stretch = -std::numeric_limits<double>::infinity();  // at the states sampled
    double sphere_work = 0;  // of moving spheres with the response "continuous", by their impulses [J]
    double work_size = 0;  // sum of its absolute values over the steps [J]
    bool other_work = false;  // whether a sphere did work that no impulse shows
    double energy_gained = 0;  // most that the total was above that of the start, where it is watched [J]

    Watched() = default;
    Watched(const Watched& other) { *this = other; }
    Watched& operator=(const Watched& other) {
        first_contact = other.first_contact.load();
        point_depth = other.point_depth.load();
        triangle_depth = other.triangle_depth;
        stretch = other.stretch;
        sphere_work = other.sphere_work;
        work_size = other.work_size;
        other_work = other.other_work;
        energy_gained = other.energy_gained;
        return *this;
    }
    void note_work(double work, bool other) {
        sphere_work += work;
        work_size += std::abs(work);
        other_work |= other;
    }
    bool in_contact() const { return first_contact < std::numeric_limits<double>::infinity(); }
};

}  // namespace clothsim
