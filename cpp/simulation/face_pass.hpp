// Keeping whole triangles out of spheres: the last part of the pass for continuous contact.
//
// A triangle may dip into a sphere although its corners stay out, and a sphere smaller than a cell may pass
// between them. Every triangle is therefore tested against the moving sphere itself (collision/triangle.hpp), as
// large as it is now. Where it touches, at the place with weights w, the three corners answer together as one
// point of mass 1 / sum(w^2 / m): each moves and changes its velocity in proportion to w / m. A corner that is
// pinned takes no part.
//
// Triangles share corners, so this goes on in sweeps until none touches; what is left after that is lifted out of
// the way without further bounces. A sweep goes color by color: triangles of one color share neither a corner nor a
// spring between corners, so the compute shader answers them at the same time with the same result.
#pragma once

#include <limits>
#include <vector>

#include "collision/exact.hpp"
#include "collision/triangle.hpp"
#include "simulation/engine.hpp"

namespace clothsim {

// A direction a triangle and sphere, as the last look at it found it: a triangle that lies far enough along it all
// through the step needs no further look. Only saves time: a triangle skipped is one that would not be touched.
using SeparatingPlanes = std::vector<std::vector<Vec3>>;

// Triangles are kept this part of the radius away, and rounding; contacts are told apart to as much.
inline constexpr double face_tolerance = 2e-7;

template <class Points>
class FacePass {
public:
    FacePass(Points& points, const Cloth& cloth, const SweptSphere& sphere, std::vector<Vec3>& planes,
             ContactReport& report)
        : points_(points), cloth_(cloth), s_(sphere), planes_(planes), report_(report),
          tolerance_(s_.slop + face_tolerance * s_.radius) {
        planes_.resize(2 * std::size_t(cloth.points()), Vec3(0, 1, 0));
    }

    // Whether anything was moved.
    bool run() {
        constexpr int rounds = 6, bouncing_sweeps = 20, lifting_sweeps = 200, spreading_sweeps = 40;
        bool any = false;
        pushed_.assign(std::size_t(cloth_.points()), 0.0);
        for (int round = 0; round < rounds; ++round) {
            load();
            find_candidates();
            bool moved = false;
            // Whether they end with one that touches nothing. One that changes nothing would be the same for ever.
            const auto sweeps = [&](int count, auto&& one) {
                for (int k = 0; k < count; ++k) {
                    bool touched = changed_ = false;
                    for (const auto& color : candidates_)
                        for (const auto& triangle : color) touched |= one(triangle);
                    moved |= changed_;
                    if (!changed_) return !touched;
                }
                return false;
            };
            sweeps(bouncing_sweeps, [&](const Triangle& t) { return bounce(t); });
            if (!sweeps(lifting_sweeps, [&](const Triangle& t) { return lift_out(t); }) &&
                !sweeps(spreading_sweeps, [&](const Triangle& t) { return spread_out(t); }))
                note_left_over();
            any |= moved;
            if (!moved) break;
        }
        return any;
    }

    // Reports the triangles that are inside, of those that were not when the step began.
    void tell_left_over() {
        load();
        find_candidates();
        note_left_over();
    }

private:
    struct Triangle {
        std::array<int, 3> corner;
        std::size_t number;
        int operator[](std::size_t i) const { return corner[i]; }
    };

    void load() {
        const int n = cloth_.points();
        start_.resize(std::size_t(n));
        end_.resize(std::size_t(n));
        const Vec3 c0 = exact::vec(s_.start), c1 = exact::vec(s_.end);
        for (int i = 0; i < n; ++i) {
            start_[std::size_t(i)] = points_.before_position(i) - c0;
            end_[std::size_t(i)] = points_.position(i) - c1;
        }
    }

    // Cells whose corners, over the step, are not all on one side of the sphere's box.
    void find_candidates() {
        for (auto& color : candidates_) color.clear();
        const double reach = s_.radius + 8 * tolerance_;
        const int rows = cloth_.rows, columns = cloth_.columns;
        const auto may_touch = [&](std::initializer_list<int> corners) {
            Vec3 low = start_[std::size_t(*corners.begin())], high = low;
            for (const int i : corners)
                for (const auto* side : {&start_, &end_}) {
                    low = low.cwiseMin((*side)[std::size_t(i)]);
                    high = high.cwiseMax((*side)[std::size_t(i)]);
                }
            return (low.array() < reach).all() && (high.array() > -reach).all();
        };
        if (rows == 1 || columns == 1) {  // a chain: its links
            for (int i = 0; i + 1 < cloth_.points(); ++i)
                if (may_touch({i, i + 1}))
                    candidates_[std::size_t(i % apart)].push_back({{i, i + 1, i + 1}, 2 * std::size_t(i)});
            return;
        }
        for (int r = 0; r + 1 < rows; ++r)
            for (int c = 0; c + 1 < columns; ++c) {
                const int i = r * columns + c, below = i + columns;
                if (!may_touch({i, i + 1, below, below + 1})) continue;
                const auto color = std::size_t(apart * (r % apart) + c % apart);
                candidates_[color].push_back({{i, i + 1, below}, 2 * std::size_t(i)});
                candidates_[color + apart * apart].push_back({{i + 1, below + 1, below}, 2 * std::size_t(i) + 1});
            }
    }

    Corners corners(const std::vector<Vec3>& of, const Triangle& t) const {
        return {of[std::size_t(t[0])], of[std::size_t(t[1])], of[std::size_t(t[2])]};
    }

    // How the corners share what happens at a place of their triangle.
    struct Share {
        std::array<double, 3> weight, part;  // of the place; displacement of a corner for one of the place
        double mobility = 0;                 // sum of w^2 / m over free corners [1/kg]
    };
    Share share(const Triangle& t, const Foot& foot) const {
        Share h{foot.weight, {0, 0, 0}, 0};
        if (t[1] == t[2]) {
            h.weight[1] += h.weight[2];
            h.weight[2] = 0;
        }
        for (std::size_t i = 0; i < 3; ++i)
            if (!points_.pinned(t[i])) h.mobility += h.weight[i] * h.weight[i] / points_.mass(t[i]);
        if (h.mobility <= 0) return h;
        for (std::size_t i = 0; i < 3; ++i)
            if (!points_.pinned(t[i])) h.part[i] = h.weight[i] / points_.mass(t[i]) / h.mobility;
        return h;
    }

    // Moves and turns the corners; what it does to their potential energy [J].
    double apply(const Triangle& t, const Share& h, const Vec3& displacement, const Vec3& velocity) {
        double work = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            if (h.part[i] == 0) continue;
            PointState state = points_.now(t[i]);
            const double before = exact::potential(points_, t[i], state.position);
            state.position += h.part[i] * displacement;
            state.velocity += h.part[i] * velocity;
            work += exact::potential(points_, t[i], state.position) - before;
            set(t[i], state);
        }
        return work;
    }

    void set(int i, const PointState& state) {
        const PointState before = points_.now(i);
        points_.set(i, state);
        const PointState after = points_.now(i);
        changed_ |= after.position != before.position || after.velocity != before.velocity;
        end_[std::size_t(i)] = points_.position(i) - exact::vec(s_.end);
    }

    bool separated(const Triangle& t) const {
        const Vec3& n = planes_[t.number];
        double least = std::numeric_limits<double>::infinity();
        for (const int i : t.corner)
            least = std::min({least, n.dot(start_[std::size_t(i)]), n.dot(end_[std::size_t(i)])});
        return least > s_.radius + 1.5 * tolerance_;
    }

    bool bounce(const Triangle& t) {
        if (separated(t)) return false;
        const Corners p0 = corners(start_, t), p1 = corners(end_, t);
        const double began = nearest_to_origin(p0).point.norm();
        if (began < s_.radius - tolerance_) return false;  // was inside: lift_out's part
        const TriangleTouch touch = triangle_touch(p0, p1, s_.radius, tolerance_);
        planes_[t.number] = touch.normal;
        if (!touch.hit) return false;
        const Share h = share(t, touch.foot);
        if (h.mobility <= 0) {
            report_.note_pinned(pinned_corner(t));
            return false;
        }
        Vec3 way = Vec3::Zero(), velocity = -exact::vec(s_.velocity), gain = Vec3::Zero();
        for (std::size_t i = 0; i < 3; ++i) {
            const PointState now = points_.now(t[i]);
            way += h.weight[i] * (p1[i] - p0[i]);
            velocity += h.weight[i] * now.velocity;
            gain += h.weight[i] * (now.velocity - points_.before(t[i]).velocity);
        }
        const Vec3& n = touch.normal;
        const double rest = 1 - touch.time, normal_way = std::min(way.dot(n), 0.0);
        const double depth = -rest * normal_way;
        if (!(depth > tolerance_ / 2)) return false;
        const double speed = velocity.dot(n), press = -gain.dot(n) / s_.dt;
        const double arrival = std::sqrt(std::max(speed * speed - 2 * press * depth, 0.0));
        double leaving = std::max(speed, s_.restitution * arrival);
        const double work = apply(t, h, depth * n, Vec3::Zero());
        if (2 * s_.restitution * arrival > press * s_.dt) {
            const double arrival2 = std::max(speed * speed - 2 * h.mobility * work, 0.0);
            const double leaving2 = s_.restitution * s_.restitution * arrival2;
            const double height = s_.restitution * depth;
            const double last2 = leaving2 - 2 * h.mobility * apply(t, h, height * n, Vec3::Zero());
            if (last2 < 0) apply(t, h, -height * n, Vec3::Zero());
            leaving = std::sqrt(last2 < 0 ? leaving2 : last2);
        }
        const Vec3 tangential = velocity - speed * n;
        const double slip = tangential.norm(), most = s_.friction * std::max(leaving - speed, 0.0);
        const double lost = s_.friction > 0 ? (slip > most ? most / slip : 1.0) : 0.0;
        apply(t, h, -lost * rest * (way - normal_way * n), (leaving - speed) * n - lost * tangential);
        return true;
    }

    // At the end of the step no place of a triangle is inside, however it came there.
    bool lift_out(const Triangle& t) {
        if (separated(t)) return false;
        const Foot foot = nearest_to_origin(corners(end_, t));
        const double distance = foot.point.norm();
        const double began = nearest_to_origin(corners(start_, t)).point.norm();
        const bool was_inside = began < s_.radius - tolerance_;
        const double aim = s_.radius + 4 * tolerance_;
        const double limit = was_inside ? std::min(s_.radius + 2 * tolerance_, began + s_.push) : s_.radius + tolerance_;
        if (distance >= limit) return false;
        const Share h = share(t, foot);
        if (h.mobility <= 0) {
            report_.note_pinned(pinned_corner(t));
            return false;
        }
        const Vec3 n = distance > 0 ? Vec3(foot.point / distance) : Vec3(0, 1, 0);
        Vec3 velocity = -exact::vec(s_.velocity);
        for (std::size_t i = 0; i < 3; ++i) velocity += h.weight[i] * points_.now(t[i]).velocity;
        const double inwards = std::min(velocity.dot(n), 0.0);
        // Beside a pinned corner a small weight would throw the free one far: in several sweeps instead.
        const double longest = *std::max_element(h.part.begin(), h.part.end());
        double lift = ((was_inside ? std::min(aim, began + s_.push) : aim) - distance) / std::max(1.0, longest / 4);
        if (was_inside) {  // a corner goes no faster for being shared, nor for having been inside itself
            for (std::size_t i = 0; i < 3; ++i) {
                double& pushed = pushed_[std::size_t(t[i])];
                if (pushed == 0 && start_[std::size_t(t[i])].norm() < s_.radius - tolerance_) pushed = s_.push;
                if (h.part[i] > 0) lift = std::min(lift, (s_.push - pushed) / h.part[i]);
            }
            if (lift <= 1e-3 * s_.push && inwards == 0) return false;
            lift = std::max(lift, 0.0);
            for (std::size_t i = 0; i < 3; ++i) pushed_[std::size_t(t[i])] += h.part[i] * lift;
        }
        apply(t, h, lift * n, -inwards * n);
        return true;
    }

    // Where sharing does not come to an end: every corner out to where a triangle of this size is safe,
    // sqrt(r^2 + rho^2) with rho the radius of the smallest circle around it.
    bool spread_out(const Triangle& t) {
        const Corners now = corners(end_, t);
        const double began = nearest_to_origin(corners(start_, t)).point.norm();
        if (began < s_.radius - tolerance_ || nearest_to_origin(now).point.norm() >= s_.radius + tolerance_) return false;
        const double safe = std::hypot(s_.radius + 4 * tolerance_, smallest_circle(now));
        bool moved = false;
        for (std::size_t i = 0; i < 3; ++i) {
            const double distance = now[i].norm();
            if (points_.pinned(t[i]) || distance >= safe || distance == 0) continue;
            PointState state = points_.now(t[i]);
            state.position += (safe / distance - 1) * now[i];
            set(t[i], state);
            moved = true;
        }
        return moved;
    }

    void note_left_over() {
        for (const auto& color : candidates_)
            for (const Triangle& t : color) note_if_left_over(t);
    }

    void note_if_left_over(const Triangle& t) {
        const double began = nearest_to_origin(corners(start_, t)).point.norm();
        if (began < s_.radius - tolerance_ || nearest_to_origin(corners(end_, t)).point.norm() >= s_.radius) return;
        const int held = pinned_corner(t);
        if (held >= 0) report_.note_pinned(held);
        else report_.note_shut_in(t[0]);
    }
    int pinned_corner(const Triangle& t) const {
        for (int c = 0; c < 3; ++c)
            if (points_.pinned(t[c])) return t[c];
        return -1;
    }

    Points& points_;
    const Cloth& cloth_;
    const SweptSphere& s_;
    std::vector<Vec3>& planes_;
    ContactReport& report_;
    double tolerance_;  // m
    std::vector<Vec3> start_, end_;  // in the sphere's frame
    bool changed_ = false;           // whether the sweep changed a number
    std::vector<double> pushed_;     // how far corners were pushed out of where they started inside, this step [m]
    static constexpr int apart = 4;  // cells of one color, along rows and columns: springs reach two
    std::array<std::vector<Triangle>, 2 * apart * apart> candidates_;
};

// Spheres in turn until none has moved anything; what they push into one another for ever has no place. Whether any has.
template <class Points>
bool keep_faces_out(Points& points, const Cloth& cloth, const std::vector<const Sphere*>& spheres,
                    const std::vector<SweptSphere>& swept, SeparatingPlanes& planes, ContactReport& report) {
    constexpr int rounds = 30;
    planes.resize(spheres.size());
    bool any = false;
    for (int round = 0; round < rounds; ++round) {
        bool moved = false;
        int count = 0;
        for (std::size_t k = 0; k < spheres.size(); ++k) {
            if (!spheres[k]->faces) continue;
            ++count;
            moved |= FacePass<Points>(points, cloth, swept[k], planes[k], report).run();
        }
        any |= moved;
        if (!moved || count == 1) return any;
    }
    for (std::size_t k = 0; k < spheres.size(); ++k)
        if (spheres[k]->faces) FacePass<Points>(points, cloth, swept[k], planes[k], report).tell_left_over();
    return any;
}

}  // namespace clothsim
