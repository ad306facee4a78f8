// The responses of Kim et al., section 5, after a step: obstacle after obstacle, the state of a
// mass point inside at the end of the step, and what becomes of it. Points do not depend on each
// other, so any number of threads gives the same bits.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

#include "measure/impulses.hpp"
#include "memory/plan.hpp"
#include "memory/state_points.hpp"
#include "memory/threads.hpp"

namespace clothsim {

// The sphere at the end of a step.
struct Contact {
    const Sphere& sphere;
    Surface surface;
    Vec3 velocity;
    double top;  // level below which points are in contact
    double dt;  // of the step that ends then [s]

    // `origin`: of the places of points [m].
    Contact(const Sphere& s, double t, double step, const Vec3& origin)
        : sphere(s),
          surface(s.surface_at(t, origin)),
          velocity(s.velocity_at(t)),
          top(surface.level_at(s.offset)),
          dt(step) {}

    // Returns the velocity on which the response acts: relative to the sphere, or absolute in the
    // as_printed reading.
    Vec3 relative(const Vec3& v) const { return sphere.as_printed ? v : Vec3(v - velocity); }
};

// Returns the unit normal at d; a point at the exact centre leaves along that of the place.
inline Vec3 outward_normal(const Surface& surface, const Vec3& d) {
    const Vec3 m = surface.gradient(d);
    const double length = m.norm();
    return length > 0 ? Vec3(m / length) : surface.normal;
}

// Reflects about the tangent plane (eq 7), scaled by restitution, with Coulomb friction: the
// tangential impulse is at most friction times the normal impulse. As printed, the velocity is
// reflected in any case.
inline Vec3 reflection(const Contact& contact, const Vec3& velocity, const Vec3& normal) {
    const double normal_speed = contact.relative(velocity).dot(normal);
    if (normal_speed >= 0 && !contact.sphere.as_printed) return velocity;
    const double impulse = (1 + contact.sphere.restitution) * normal_speed;
    Vec3 result = velocity - impulse * normal;
    if (contact.sphere.friction > 0) {
        const Vec3 tangential = contact.relative(velocity) - normal_speed * normal;
        const double speed = tangential.norm();
        const double most = contact.sphere.friction * std::abs(impulse);
        result -= speed <= most ? tangential : Vec3(most / speed * tangential);
    }
    return result;
}

// Method 1 reflects the velocity, and leaves the position alone.
inline PointState respond_reflect(const Contact& contact, const PointState& point) {
    const Vec3 normal = outward_normal(contact.surface, point.position - contact.surface.place);
    return {point.position, reflection(contact, point.velocity, normal)};
}

// Returns |v|, also of velocities so small or so large that their squares would vanish or overflow.
// It is written out, because the summation order of Eigen's stableNorm depends on where its operand
// lies in memory.
inline double length_of(const Vec3& v) {
    const double largest = v.cwiseAbs().maxCoeff();
    return largest > 0 ? largest * (v / largest).norm() : 0;
}

// Method 2: cast a ray from the point back along its velocity. The point moves to the intersection
// of ray and surface, and its velocity is reflected there.
//
// With b = -v/|v| the level (model/sphere.hpp) along the ray is f + 2 s m.b + k s^2: eq 9
// with its errata corrected, over the radius. Division by v.v makes no speed too small. The point
// lies inside, C = f - top < 0, so exactly one distance along the ray is positive:
//
//   s = (-B + sqrt(B^2 - k C)) / k   =   -C / (B + sqrt(B^2 - k C)),   B = m.b
//
// The form without cancellation is taken by the sign of B, which is what eq 11 and 12 are for.
//
// The paper leaves the point there. Each contact then loses the part s / |v| of the step. A point
// on the sphere, as with a restitution below 1, slides at (1 + e) / 2 of its speed at any time
// step. So with e < 1 or friction the point goes on from the surface for that time, at its new
// velocity. A point that starts inside goes on for the step. With e = 1 and no friction, touches
// are rare and the loss is of the order of the time step. The paper's reading then stays.
//
// No point goes back by more than its way in the step: a ray that grazes a plane would throw it far
// away.
inline PointState respond_ray(const Contact& contact, const PointState& point) {
    const Sphere& sphere = contact.sphere;
    const Surface& surface = contact.surface;
    const double k = surface.curvature;
    Vec3 d = point.position - surface.place;
    const Vec3 m = surface.gradient(d);
    const Vec3 v = contact.relative(point.velocity);
    const double speed = length_of(v);
    const double lacks = contact.top - surface.level(d);
    double rest = 0;  // time since the point was at the surface [s]
    const Vec3 back = speed > 0 ? Vec3(-v / speed) : Vec3(Vec3::Zero());
    const double b = m.dot(back);
    const double root = std::sqrt(b * b + k * lacks);
    if (b < 0 && !sphere.as_printed) return point;  // on its way out
    if (speed > 0 && root > 0) {
        double way = b > 0 ? lacks / (b + root) : (root - b) / k;
        if (!sphere.as_printed) way = std::min(way, speed * contact.dt);
        d += way * back;
        rest = std::min(way / speed, contact.dt);
    } else if (const double w = m.squaredNorm(); w > 0) {
        // A point without a ray, at rest or along a plane, is projected along the normal.
        d += lacks / (w + std::sqrt(w * (1 + k * contact.top))) * m;
    } else {
        d = surface.height(contact.top) * surface.normal;
    }
    const Vec3 velocity = reflection(contact, point.velocity, outward_normal(surface, d));
    if (!sphere.as_printed && (sphere.restitution < 1 || sphere.friction > 0))
        d += rest * contact.relative(velocity);
    return {surface.place + d, velocity};
}

inline bool touches(const Contact& contact, const Vec3& position) {
    return contact.surface.level(position - contact.surface.place) < contact.top;
}

inline PointState respond(const Contact& contact, const PointState& point) {
    return contact.sphere.response == Response::ray ? respond_ray(contact, point)
                                                    : respond_reflect(contact, point);
}

// The level, with a curvature, below which a point may be in contact: rounding by epsilon hides
// none. It grows with the distance, which the smaller curvature covers.
struct NearLevel {
    double level, curvature;

    NearLevel(const Contact& contact, const Cloth& cloth, double epsilon) {
        const double size = std::min(contact.sphere.radius,
                                     4 *
                                         std::hypot((cloth.rows - 1) * cloth.row_spacing,
                                                    (cloth.columns - 1) * cloth.column_spacing));
        level = contact.top + 64 * epsilon * (size + contact.surface.place.lpNorm<1>());
        curvature = contact.surface.curvature - 64 * epsilon / size;
    }
};

// What the responses after some steps have done.
struct Responses {
    std::int64_t count = 0;
    bool changed = false;  // whether a mass point was changed
    double depth = 0;  // largest of mass points that they found below a surface [m]
};

template <class Real, class Layout>
class PaperResponses {
public:
    PaperResponses(const Plan& plan, const Layout& layout, Impulses& impulses)
        : plan_(plan),
          layout_(layout),
          points_(layout_, plan.cloth.columns),
          impulses_(impulses),
          kernels_(kernels_of<Real>(*plan.kernels)),
          geometry_(layout.geometry(kernels_.lanes)) {}
    PaperResponses(const PaperResponses&) = delete;

    // Respond after the step of dt that ends at the time t; positions are relative to an origin
    // [m].
    Responses respond(AlignedVector<Real>& memory, double t, double dt, const Vec3& origin,
                      int threads) {
        std::vector<int> near_points;
        std::vector<std::vector<int>> of_parts;
        Responses all;
        for (std::size_t number = 0; number < plan_.spheres.size(); ++number) {
            const Sphere& sphere = plan_.spheres[number];
            if (sphere.penalty()) continue;
            const double step = 2 * double(Real(dt / 2));  // as the shader has it
            const Contact contact(sphere, t, step, origin);
            const SurfaceLevel<Real> level = bound_of_level(contact);
            const std::int64_t most =
                plan_.cloth.points() / heuristics::points_per_thread_of_response;
            const int parts = int(std::clamp<std::int64_t>(most, 1, threads));
            std::atomic<std::int64_t> count{0};
            std::atomic<bool> changed{false};
            of_parts.assign(std::size_t(parts), {});
            run_in_team(parts, [&](int thread, int team) {
                std::vector<int>& near = of_parts[std::size_t(thread)];
                std::int64_t responses = 0;
                bool has_changed = false;
                for (int r = geometry_.rows * thread / team;
                     r < geometry_.rows * (thread + 1) / team; ++r)
                    each_point_near_surface(memory, r, level, [&](int i) {
                        near.push_back(i);
                        if (plan_.cloth.pinned[std::size_t(i)] ||
                            !touches(contact, points_.position(memory, i)))
                            return;
                        ++responses;
                        has_changed |= respond(memory, number, contact, i);
                    });
                count += responses;
                if (has_changed) changed = true;
            });
            all.count += count;
            all.changed |= changed;
            for (const std::vector<int>& near : of_parts)
                near_points.insert(near_points.end(), near.begin(), near.end());
        }
        // Depths count pinned points too; no other point can be inside.
        for (const Sphere& sphere : plan_.spheres) {
            if (sphere.penalty()) continue;
            const Surface surface = sphere.surface_at(t, origin);
            for (const int i : near_points) {
                const double level = surface.level(points_.position(memory, i) - surface.place);
                all.depth = std::max(all.depth, -surface.height(level));
            }
        }
        return all;
    }

private:
    SurfaceLevel<Real> bound_of_level(const Contact& contact) const {
        const NearLevel near(contact, plan_.cloth, std::numeric_limits<Real>::epsilon());
        SurfaceLevel<Real> level{};
        for (int k = 0; k < 3; ++k) {
            level.place[k] = Real(contact.surface.place[k]);
            level.normal[k] = Real(contact.surface.normal[k]);
        }
        level.curvature = Real(near.curvature);
        level.below = Real(near.level);
        return level;
    }
    // Calls `visit(i)` for the points of a row that may be below a level.
    template <class Visit>
    void each_point_near_surface(const AlignedVector<Real>& memory, int row,
                                 const SurfaceLevel<Real>& level, const Visit& visit) const {
        const Real* const first = memory.data() + layout_.first() + row * geometry_.row;
        for (int j = 0; j < geometry_.vectors; ++j) {
            std::uint64_t lanes =
                kernels_.below(first + j * geometry_.vector, geometry_.component, level);
            for (; lanes != 0; lanes &= lanes - 1) {
                const int column = layout_.column(j, __builtin_ctzll(lanes), kernels_.lanes);
                if (column < plan_.cloth.columns) visit(row * plan_.cloth.columns + column);
            }
        }
    }
    bool respond(AlignedVector<Real>& memory, std::size_t number, const Contact& contact, int i) {
        const int columns = plan_.cloth.columns;
        const PointState start = points_.get(memory, i);
        const PointState result = clothsim::respond(contact, start);
        impulses_.give(number, i / columns, i % columns,
                       plan_.cloth.mass[std::size_t(i)] * (result.velocity - start.velocity));
        points_.set(memory, i, result);
        return result != start;
    }

    const Plan& plan_;
    const Layout& layout_;
    StatePoints<Real, Layout> points_;
    Impulses& impulses_;
    const RealKernels<Real>& kernels_;
    VectorGeometry geometry_;
};

}  // namespace clothsim
