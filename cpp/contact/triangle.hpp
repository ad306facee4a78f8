// A triangle of moving corners against a sphere: the first time at which they touch.
//
// In the sphere's frame every corner goes straight from p0 to p1. At a time t the point y of the triangle
// nearest to the centre has the distance d and the direction n = y / d. The whole triangle lies beyond the
// plane through y across n. Take the parallel plane at distance `reach` from the centre. As long as every
// corner stays beyond it, so does the triangle. The earliest time at which a corner reaches it is safe to go
// to. That is conservative advancement (Mirtich 1996) with the direction taken into account: a triangle that
// moves sideways or away is not slowed. Close to contact it converges like Newton's method. It never goes
// past a contact.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <Eigen/Geometry>

#include "model/sphere.hpp"

namespace clothsim {

using Corners = std::array<Vec3, 3>;

// The point of a triangle nearest to the origin.
struct Foot {
    Vec3 point;
    std::array<double, 3> weight;
};

// Offers the nearest place of the side from corner i to the next.
inline void offer_side(const Corners& c, std::size_t i, Foot& best, double& least) {
    const std::size_t j = (i + 1) % 3;
    const Vec3 side = c[j] - c[i];
    const double length2 = side.squaredNorm();
    const double s = length2 > 0 ? std::clamp(-side.dot(c[i]) / length2, 0.0, 1.0) : 0.0;
    const Vec3 point = c[i] + s * side;
    const double distance2 = point.squaredNorm();
    if (distance2 >= least) return;
    least = distance2;
    best = {point, {0, 0, 0}};
    best.weight[i] = 1 - s;
    best.weight[j] = s;
}

// Offers the foot of the perpendicular, if it lies inside. The height on the longest side is orthogonalised
// against that side, so that its direction is right to rounding however thin the triangle is.
inline void offer_inside_of_thin(const Corners& c, Foot& best, double& least) {
    std::size_t i = 0;
    double longest2 = -1;
    for (std::size_t k = 0; k < 3; ++k) {
        const double length2 = (c[(k + 1) % 3] - c[k]).squaredNorm();
        if (length2 > longest2) i = k, longest2 = length2;
    }
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    const Vec3 side = c[j] - c[i], other = c[k] - c[i];
    if (longest2 == 0) return;
    const double foot = other.dot(side) / longest2;
    Vec3 height = other - foot * side;
    height -= height.dot(side) / longest2 * side;
    const double height2 = height.squaredNorm();
    if (height2 == 0) return;
    const double along = -c[i].dot(side) / longest2;
    const double up = -(c[i] + along * side).dot(height) / height2;
    const std::array<double, 3> w{1 - up - (along - up * foot), along - up * foot, up};  // of i, j, k
    if (w[0] < 0 || w[1] < 0 || w[2] < 0) return;
    const Vec3 point = c[i] + w[1] * side + w[2] * other;
    const double distance2 = point.squaredNorm();
    if (distance2 >= least) return;
    least = distance2;
    best.point = point;
    best.weight[i] = w[0];
    best.weight[j] = w[1];
    best.weight[k] = w[2];
}

// The foot of the perpendicular if it lies inside, else the nearest place of the sides that it lies beyond.
// In a thin or collapsed triangle rounding hides which these are: then all count. Every candidate is a point
// of the triangle.
inline Foot nearest_to_origin(const Corners& c) {
    // Squared sine of the angle at the first corner: the root of the rounding of a product. Half or twice
    // changes no drape and no shot.
    constexpr double thin = 1e-8;
    const Vec3 ab = c[1] - c[0], ac = c[2] - c[0];
    const Vec3 normal = ab.cross(ac);
    const double area2 = normal.squaredNorm();
    const bool flat = !(area2 > thin * ab.squaredNorm() * ac.squaredNorm());
    std::array<double, 3> inner{-1, -1, -1};
    if (!flat) {
        const Vec3 across = c[0].cross(normal);
        inner[1] = across.dot(ac) / area2;
        inner[2] = -across.dot(ab) / area2;
        inner[0] = 1 - inner[1] - inner[2];
        if (inner[0] >= 0 && inner[1] >= 0 && inner[2] >= 0)
            return {c[0] + inner[1] * ab + inner[2] * ac, inner};
    }
    Foot best{c[0], {1, 0, 0}};
    double least = c[0].squaredNorm();
    for (std::size_t i = 0; i < 3; ++i)
        if (inner[(i + 2) % 3] < 0) offer_side(c, i, best, least);
    if (flat) offer_inside_of_thin(c, best, least);
    return best;
}

// At a part of the way.
inline Corners corners_at(const Corners& p0, const Corners& p1, double time) {
    return {p0[0] + time * (p1[0] - p0[0]), p0[1] + time * (p1[1] - p0[1]), p0[2] + time * (p1[2] - p0[2])};
}

struct TriangleTouch {
    bool hit = false;
    double time = 0;  // part of the way
    Foot foot;
    Vec3 normal = Vec3::Zero();
    Vec3 first_normal = Vec3::Zero();  // when the way begins
};

// Whether the triangle keeps beyond `reach` of a plane that turns from the direction n0 to n1, both at most
// of length 1.
inline bool beyond_turning_plane(const Corners& p0, const Corners& p1, const Vec3& n0, const Vec3& n1,
                                 double reach) {
    double least = reach + 1;
    for (std::size_t i = 0; i < 3; ++i)
        least = std::min({least, n0.dot(p0[i]), n1.dot(p1[i]), (n0.dot(p1[i]) + n1.dot(p0[i])) / 2});
    return least > reach;
}

// The first time at which the triangle comes as near as `reach`, to within `tolerance` above it.
//
// A triangle that turns on the sphere lowers a corner all the time, and a fixed plane lets it go no
// further than the gap. A plane that turns with it lets it leap: from the present direction n0 to a later
// direction n1. On the way, ((1 - s) n0 + s n1).c(s) is of degree 2 in s. It is above `reach` if its three
// Bernstein coefficients are. The first and the last are for any corner c; the middle one is (n0.c(1) +
// n1.c(0)) / 2.
//
// A later time may be known at which the triangle is nearer than `reach`. Then a leap goes at least to the
// time of the touch by regula falsi.
inline TriangleTouch triangle_touch(const Corners& p0, const Corners& p1, double reach, double tolerance) {
    constexpr double shortest_leap = 1e-12;  // of the step; not tuned: above the rounding of a time
    // A bound: a triangle that needs more grazes all along, and counts as touching. Half or twice changes no
    // drape and no shot.
    constexpr int most_advances = 500;
    TriangleTouch t;
    Corners now = p0;
    t.foot = nearest_to_origin(now);
    double leap = 0;
    double late = 2, near = 0;  // a time at which the triangle is nearer than `reach`, and its distance then;
                                // 2: none is known
    for (int k = 0; k < most_advances; ++k) {
        const double distance = t.foot.point.norm();
        t.normal = distance > 0 ? Vec3(t.foot.point / distance) : Vec3(0, 1, 0);
        t.hit = distance <= reach + tolerance;
        if (k == 0) t.first_normal = t.normal;
        if (t.hit) return t;
        if (k == 0) {  // most ways touch nothing at all
            const Foot last = nearest_to_origin(p1);
            const double far = last.point.norm();
            const Vec3 normal = last.point / (far > 0 ? far : 1);
            if (far > reach + tolerance && beyond_turning_plane(p0, p1, t.normal, normal, reach)) {
                t.time = 1;
                t.foot = last;
                t.normal = normal;
                return t;
            }
            if (far <= reach) late = 1, near = far;
        }
        double advance = 2, lowest = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            const double rate = t.normal.dot(p1[i] - p0[i]), gap = t.normal.dot(now[i]) - reach;
            lowest = std::min(lowest, gap);
            if (rate < 0) advance = std::min(advance, gap / -rate);
        }
        // Rounding hides which place is nearest: no plane shows that the triangle is clear.
        t.hit = lowest < 0;
        if (t.hit) return t;
        if (t.time + advance >= 1) {
            if (advance == 2 || t.time >= 1) return t;
            advance = 1 - t.time;  // the end itself is checked once
        }
        const auto expected = [&] {
            return (distance - reach - tolerance / 2) / (distance - near) * (late - t.time);
        };
        leap = k == 0 ? 0.0 : std::max(2 * leap, 4 * advance);
        if (late <= 1) leap = std::min(std::max(leap, expected()), 0.9 * (late - t.time));
        else if (k == 0) leap = 0.5;
        bool leapt = false;
        while (!leapt) {
            const double next = std::min(t.time + leap, 1.0), length = next - t.time;
            if (length <= std::max(2 * advance, shortest_leap)) break;
            const Corners then = corners_at(p0, p1, next);
            const Foot foot = nearest_to_origin(then);
            const double far = foot.point.norm();
            const Vec3 normal = foot.point / (far > 0 ? far : 1);
            leapt = far > reach;
            for (std::size_t i = 0; i < 3; ++i)
                leapt = leapt && normal.dot(now[i]) + t.normal.dot(then[i]) > 2 * reach;
            if (leapt) {
                t.time = next;
                t.foot = foot;
                now = then;
                leap = length;
            } else if (far <= reach) {
                late = next;
                near = far;
                leap = std::min(expected(), 0.9 * length);
            } else {
                leap = length / 2;
            }
        }
        if (leapt) continue;
        leap = advance;
        t.time = std::min(t.time + advance, 1.0);
        now = corners_at(p0, p1, t.time);
        t.foot = nearest_to_origin(now);
    }
    t.hit = true;
    return t;
}

}  // namespace clothsim
