// Extremes over the states of a run: the initial one, and each at the end of a step.
#pragma once

#include <atomic>
#include <limits>

namespace clothsim {

// A number that the threads of a step change together, and a copy of a checkpoint.
template <class T>
struct Shared : std::atomic<T> {
    using std::atomic<T>::atomic, std::atomic<T>::operator=;
    Shared(const Shared& other) : std::atomic<T>(other.load()) {}
    Shared& operator=(const Shared& other) {
        this->store(other.load());
        return *this;
    }
};

// The order of threads does not change the result.
inline void lower(std::atomic<double>& least, double value) {
    double now = least.load(std::memory_order_relaxed);
    while (value < now && !least.compare_exchange_weak(now, value, std::memory_order_relaxed)) {
    }
}
struct Watched {
    Shared<double> first_contact{
        std::numeric_limits<double>::infinity()};  // end of the first step that a response changed [s]
    double point_depth = 0;  // of mass points below a sphere's surface, every step [m]
    double lift_work = 0;  // energy that the growth of cells on spheres has made [J]
    double triangle_depth = 0;           // of triangles, at the states sampled [m]
    double stretch = -std::numeric_limits<double>::infinity();  // at the states sampled
    double energy_gained = 0;  // most that the total was above that of the start, where it is watched [J]

    bool in_contact() const { return first_contact < std::numeric_limits<double>::infinity(); }
};

}  // namespace clothsim
