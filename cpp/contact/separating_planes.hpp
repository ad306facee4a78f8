// Steps that need no contact pass, as the cloth is clear of the spheres.
//
// Within a step a mass point goes straight from place to place, and so does a sphere. Take a plane
// that lies between the two at both ends of the step. Then they do not touch in the step, nor does
// the sphere touch a triangle of such points. While the cloth stays beyond a plane beside every
// sphere's path, a comparison per point replaces the contact pass. The number of such steps is
// predicted and checked afterwards. If the check fails, the caller goes back to an earlier state
// and takes those steps with the pass.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "kernels/kernel_table.hpp"
#include "model/clock.hpp"
#include "model/sphere.hpp"

namespace clothsim {

// Across which axis a plane keeps a cloth from a sphere, and whether the cloth is above it.
template <class Real>
struct SeparatingPlane {
    int axis;
    bool above;
    Real plane;
};

template <class Real>
class SeparatingPlanes {
public:
    explicit SeparatingPlanes(const RealKernels<Real>& kernels) : kernels_(kernels) {}

    // How many of the next steps, at most `most`, are expected to be clear. `component(k)`: of the
    // whole cloth (k = 0..2: x, y, z, 3..5: their velocities).
    template <class Component>
    std::int64_t clear_steps(const std::vector<Sphere>& spheres, const Vec3& gravity,
                             const Clock& clock, std::int64_t most, const Component& component) {
        if (clock.origin != origin_ || clock.dt != dt_) drop();
        origin_ = clock.origin;
        dt_ = clock.dt;
        if (clock.steps >= end_) find(spheres, gravity, clock, component);
        return planes_.empty() ? 0 : std::min(most, end_ - clock.steps);
    }
    // The state has changed: what was found holds no longer.
    void drop() { end_ = std::numeric_limits<std::int64_t>::min(); }

    // Before and after steps under guard.
    void raise() {
        crossed_.store(false, std::memory_order_relaxed);
        up_ = true;
    }
    bool lower() {
        up_ = false;
        if (crossed_) drop();
        return !crossed_;
    }
    bool up() const { return up_; }
    // Some rows are at the end of a step. By any thread.
    template <class Component>
    void check(const Component& component) {
        for (const SeparatingPlane<Real>& separating_plane : planes_)
            if (!kernels_.beyond(component(separating_plane.axis), separating_plane.above,
                                 separating_plane.plane))
                crossed_.store(true, std::memory_order_relaxed);
    }

private:
    // Most steps behind a plane, and until the next search where there is none. The extents take a
    // few hundredths of a step: half doubles that cost, twice makes predictions longer.
    static constexpr int longest = 64;
    // Steps. Fewer steps behind planes do not pay for the checkpoint. Half or twice changes drapes
    // by less than the spread, 3 %.
    static constexpr int shortest = 4;

    template <class Component>
    void find(const std::vector<Sphere>& spheres, const Vec3& gravity, const Clock& clock,
              const Component& component) {
        planes_.clear();
        end_ = clock.steps + longest;
        std::array<Extent<Real>, 3> place, speed;
        for (int k = 0; k < 3; ++k) place[std::size_t(k)] = kernels_.extent(component(k));
        std::vector<std::vector<Vec3>> places;
        for (const Sphere& sphere : spheres) {
            places.emplace_back();
            if (sphere.penalty()) continue;
            for (int k = 0; k <= longest; ++k)
                places.back().push_back(sphere.place_at(clock.at(k)));
            if (!widest(place, {}, Vec3::Zero(), sphere, places.back(), 0, clock.dt)) return;
        }
        for (int k = 0; k < 3; ++k) speed[std::size_t(k)] = kernels_.extent(component(3 + k));
        for (int steps = longest; steps >= shortest && planes_.empty(); steps /= 4) {
            for (std::size_t i = 0; i < spheres.size(); ++i) {
                if (spheres[i].penalty()) continue;
                const auto separating_plane =
                    widest(place, speed, gravity, spheres[i], places[i], steps, clock.dt);
                if (!separating_plane) {
                    planes_.clear();
                    break;
                }
                planes_.push_back(*separating_plane);
            }
            if (!planes_.empty()) end_ = clock.steps + steps;
        }
    }

    // The plane from which the cloth is farthest after so many steps, at twice the speeds it has.
    // `places`: of the sphere.
    static std::optional<SeparatingPlane<Real>> widest(const std::array<Extent<Real>, 3>& place,
                                                       const std::array<Extent<Real>, 3>& speed,
                                                       const Vec3& gravity, const Sphere& sphere,
                                                       const std::vector<Vec3>& places, int steps,
                                                       double dt) {
        const double time = steps * dt;
        Vec3 low = places[0], high = places[0];
        for (int i = 0; i <= steps; ++i) {
            low = low.cwiseMin(places[std::size_t(i)]);
            high = high.cwiseMax(places[std::size_t(i)]);
        }
        // More than what rounding and the tolerances of contacts and triangles come to.
        const double size = (sphere.flat() ? 0 : sphere.radius) + sphere.reach(),
                     reach = sphere.reach() +
            1e-4 * (size + std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff()));
        std::optional<SeparatingPlane<Real>> found;
        double farthest = 0;
        for (int k = 0; k < 3; ++k) {
            const auto& [slowest, fastest] = speed[std::size_t(k)];
            const double fall = std::abs(gravity[k]) * time * time;
            for (const bool above : {true, false}) {
                // How far the surface reaches from its place to that side.
                const double to_side = above ? 1 - sphere.normal[k] : 1 + sphere.normal[k],
                             most = to_side > 0 ? sphere.radius * to_side + reach : reach;
                const double surface = above ? high[k] + most : low[k] - most;
                const double gap = above ? double(place[std::size_t(k)].low) +
                        2 * std::min(double(slowest), 0.0) * time - fall - surface
                                         : surface - double(place[std::size_t(k)].high) -
                        2 * std::max(double(fastest), 0.0) * time - fall;
                if (!(gap > farthest)) continue;
                farthest = gap;
                found = {k, above, Real(surface)};
            }
        }
        return found;
    }

    const RealKernels<Real>& kernels_;
    double origin_ = 0, dt_ = 0;  // of the clock
    // Step of the clock of the next search.
    std::int64_t end_ = std::numeric_limits<std::int64_t>::min();
    std::vector<SeparatingPlane<Real>> planes_;  // one a sphere, or none
    bool up_ = false;
    std::atomic<bool> crossed_{false};
};

}  // namespace clothsim
