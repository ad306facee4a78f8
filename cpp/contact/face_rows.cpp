// Which places of the cloth come to a sphere within a step, and what the contact problem asks of them.
#include "contact/face_work.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "contact/exact.hpp"

namespace clothsim {

using exact::vec;

namespace {

constexpr double nothing = 1e9;  // m/s inwards: faster than any cloth, so half or twice bounds nothing either
// Of the margin: how near counts as on the surface. Found by drapes: half or twice changes the energy of a
// fall by 0.3 % and its time by 4 %.
constexpr double closeness = 1.0 / 16;

Vec3 weighted(const Corners& c, const std::array<double, 3>& w) {
    return w[0] * c[0] + w[1] * c[1] + w[2] * c[2];
}

// A link has two corners of a triangle in the same place.
std::array<double, 3> weights_of(const Foot& foot, const std::array<int, 3>& corner) {
    std::array<double, 3> weight = foot.weight;
    if (corner[1] == corner[2]) weight = {weight[0], weight[1] + weight[2], 0};
    return weight;
}

}  // namespace

// A row for the first place of the triangle that the way to the end leads below the surface. After the first
// round it has to lead well below: the rest is found when the next step begins.
bool FaceWork::inspect_triangle(int sphere, const Triangle& triangle, int round) {
    const Shell& shell = shells_[at(sphere)];
    const double margin = shell.surface - shell.inside;
    const double reach = round == 0 ? shell.surface : shell.middle, tolerance = margin * closeness;
    if (inside_[at(sphere)][triangle.number]) return false;
    const Frame& frame = broad_phase_.frame(sphere);
    const Corners p0 = Frame::corners(frame.start, triangle.corner),
                  p1 = Frame::corners(frame.end, triangle.corner);
    const TriangleTouch touch = triangle_touch(p0, p1, reach, tolerance);
    broad_phase_.set_plane(sphere, triangle, touch);
    if (!touch.hit) return false;
    touched = true;
    const double distance = touch.foot.point.norm();
    if (touch.time == 0 && round == 0 && distance < shell.inside - (*spheres_)[at(sphere)].slop) {
        inside_[at(sphere)][triangle.number] = 1;
        starts_inside_.push_back({sphere, triangle});
        return false;
    }
    const double slop = (*spheres_)[at(sphere)].slop,
                 after = touch.normal.dot(weighted(p1, touch.foot.weight));
    const bool reaches = round == 0 || touch.time > 0 || after < shell.middle;
    const bool added = reaches && add_row(sphere, triangle, touch.foot, touch.normal, touch.time, round);
    if (added && after < shell.surface) return true;
    // That place goes away again, or strokes past. Another may follow.
    if (broad_phase_.separated(sphere, triangle, shell.inside)) return added;
    const double deeper = touch.time == 0 ? std::min(shell.middle, distance) : shell.middle;
    const double room = deeper - shell.inside;
    const double lower = room > slop ? shell.inside + room / 2 : shell.inside - slop,
                 finer = std::max(room, slop) / 16;
    const TriangleTouch next = triangle_touch(p0, p1, lower, finer);
    broad_phase_.set_plane(sphere, triangle, next);
    if (!next.hit || next.time == 0) return added;
    return add_row(sphere, triangle, next.foot, next.normal, next.time, round) || added;
}

// As above, for a mass point and a sphere that keeps points out.
bool FaceWork::inspect_point(int sphere, int i, int round) {
    const Shell& shell = shells_[at(sphere)];
    const double margin = shell.surface - shell.inside;
    const double reach = round == 0 ? shell.surface : shell.middle;
    const Frame& frame = broad_phase_.frame(sphere);
    const Vec3 p0 = Frame::at(frame.start, i), p1 = Frame::at(frame.end, i), q = p1 - p0;
    const double far = reach + margin * closeness, a = q.squaredNorm(), b = p0.dot(q);
    const double closest = a > 0 ? std::clamp(-b / a, 0.0, 1.0) : 0.0;
    if (inside_[at(sphere)][at(i)] || (p0 + closest * q).squaredNorm() > far * far) return false;
    touched = true;
    const double start = p0.norm();
    if (round == 0 && start < shell.inside - (*spheres_)[at(sphere)].slop) {
        inside_[at(sphere)][at(i)] = 1;
        starts_inside_.push_back({sphere, {{i, i, i}, at(i)}});
        return false;
    }
    double time = 0;
    if (start > far) {
        const Vec3 m = p0 + closest * q;
        time = std::clamp(closest - std::sqrt(std::max(reach * reach - m.squaredNorm(), 0.0) / a), 0.0, 1.0);
    } else if (round > 0 && p1.norm() >= shell.middle) {
        return false;
    }
    const Vec3 place = p0 + time * q;
    const Foot foot{place, {1, 0, 0}};
    return add_row(sphere, {{i, i, i}, at(i)}, foot, outward_normal(place), time, round);
}

bool FaceWork::find_rows(int round) {
    bool found = false;
    ++inspection_;
    if (round == 0) {
        broad_phase_.note_all_moved(x);
    } else {
        // A clear path keeps a part of the smallest margin to spare.
        double slack = std::numeric_limits<double>::infinity();
        for (const Shell& shell : shells_) slack = std::min(slack, (shell.middle - shell.inside) / 16);
        broad_phase_.note_moves(x, slack);
        broad_phase_.note_drift(x, free_x_);
    }
    const auto pass = round == 0 ? FaceBroadPhase::Pass::first
        : round == most_rounds   ? FaceBroadPhase::Pass::all
                                 : FaceBroadPhase::Pass::moved;
    for (int s = 0; s < int(spheres_->size()); ++s) {
        place_in_frame(s);
        if (!faces_[at(s)]) {
            for (int i = 0; i < cloth_.points(); ++i) found |= inspect_point(s, i, round);
            continue;
        }
        const Shell& shell = shells_[at(s)];
        const double reach =
            (round == 0 ? shell.surface : shell.middle) + (shell.surface - shell.inside) * closeness;
        std::vector<std::size_t> touching;
        broad_phase_.each_open(s, reach, pass, [&](const Triangle& t) {
            poll_->passed(pieces_of_touch);
            if (inspect_triangle(s, t, round)) touching.push_back(t.number);
        });
        found |= !touching.empty();
        broad_phase_.note_touches(s, std::move(touching));
    }
    return found;
}

int FaceWork::pinned_corner(const std::array<int, 3>& corner) const {
    for (const int i : corner)
        if (cloth_.pinned[at(i)]) return i;
    return -1;
}

// Which mean of its corners the place of a row is. A mobility of 0: pinned.
void FaceWork::set_foot(ContactRow& row, const std::array<double, 3>& weight) const {
    double freely = 0;  // weight of corners that are not pinned
    row.weight = weight;
    row.mobility = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        row.part[i] = 0;
        if (cloth_.pinned[at(row.corner[i])]) continue;
        row.part[i] = weight[i] / cloth_.mass[at(row.corner[i])];
        row.mobility += weight[i] * row.part[i];
        freely += weight[i];
    }
    if (freely < least_lever) row.mobility = 0;
    row.inertia = 1 / row.mobility;
}

// The impulse of a row acts between the place that it has and a first place, so that it does no work. A unit
// impulse at either place gives velocities d0 and d1 to the corners. On their bisector, d0 / |d0| + d1 / |d1|
// by kinetic energy, the place comes as fast as it goes. On d0 alone a rocking triangle would gain energy, as
// by Euler's explicit method; on d1 it would lose it.
void FaceWork::act_between(ContactRow& row, const std::array<double, 3>& first) const {
    double first2 = 0, last2 = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const double mass = cloth_.mass[at(row.corner[i])];
        first2 += mass * first[i] * first[i];
        last2 += mass * row.part[i] * row.part[i];
    }
    const double part = std::sqrt(first2) / (std::sqrt(first2) + std::sqrt(last2));
    row.mobility = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        row.part[i] = (1 - part) * first[i] + part * row.part[i];
        row.mobility += row.weight[i] * row.part[i];
    }
    row.inertia = 1 / row.mobility;
}

// The place of contact of a rocking triangle differs between start and end of a step. Its velocity is
// judged at the end, so the next step begins without an arrival. A triangle touches a sphere at one place
// only, so other rows of the rounds ask for nothing.
void FaceWork::follow_feet() {
    if (bounced()) begun_ = rows_;
    for (int s = 0; s < int(spheres_->size()); ++s) place_in_frame(s);
    for (std::size_t k = 0; k < rows_.size(); ++k) {
        Origin& origin = origins_[k];
        if (!origin.rests() || origin.height > 0) continue;
        const int s = origin.sphere;
        const Foot foot = nearest_to_origin(Frame::corners(broad_phase_.frame(s).end, rows_[k].corner));
        if (foot.point.norm() > shells_[at(s)].near) continue;
        ContactRow row = rows_[k];
        const std::array<double, 3> last = weights_of(foot, row.corner);
        set_foot(row, last);
        if (row.mobility <= 0) continue;
        act_between(row, rows_[k].part);
        row.normal = outward_normal(foot.point);
        const Vec3 wall = vec((*spheres_)[at(s)].velocity);
        row.speed.target = wall + (row.speed.target - wall).dot(rows_[k].normal) * row.normal;
        rows_[k] = row;
        origin.feature = feature(s, row.corner, last);
        followed_[at(s)][origin.piece] = 1;
    }
    for (std::size_t k = 0; k < rows_.size(); ++k) {
        const Origin& origin = origins_[k];
        if (origin.rests() || origin.round == 0 || origin.height > 0 ||
            !followed_[at(origin.sphere)][origin.piece])
            continue;
        rows_[k].speed.target = vec((*spheres_)[at(origin.sphere)].velocity) - nothing * rows_[k].normal;
        rows_[k].speed.impulse.setZero();
    }
    for (const Origin& origin : origins_) followed_[at(origin.sphere)][origin.piece] = 0;
    v = free_v_;
    for (const ContactRow& row : rows_) row.push(v, row.speed.impulse);
}

bool FaceWork::add_row(int sphere, const Triangle& triangle, const Foot& foot, const Vec3& normal,
                       double time, int round) {
    const auto& [corner, piece] = triangle;
    const SweptSphere& s = (*spheres_)[at(sphere)];
    const Shell& shell = shells_[at(sphere)];
    const Frame& frame = broad_phase_.frame(sphere);
    ContactRow row{};
    row.corner = corner;
    set_foot(row, weights_of(foot, corner));
    row.normal = normal;
    row.friction = s.friction;
    const double before = normal.dot(row.at(frame.start)), after = normal.dot(row.at(frame.end));
    double level = shell.surface;
    if (after >= shell.surface && time > 0) {  // below it on the way alone
        if (round == 0 && before + time * (after - before) > shell.middle) return false;
        level = std::max(level, (shell.surface - (1 - time) * before) / time);
        if (level <= after) return false;
    }
    if (row.mobility <= 0) {
        if (after < shell.inside) report_.note_pinned(pinned_corner(corner));
        return false;
    }
    // Two triangles touch at the side or corner that they share.
    const std::size_t number = feature(sphere, corner, row.weight);
    std::uint32_t& seen = seen_[number];
    if (seen == inspection_) return false;
    seen = inspection_;
    Origin origin{sphere, number, piece, round, time};
    row.place.target = vec(s.end) + level * normal;
    row.speed.target = vec(s.velocity);
    aim(row, origin, level - after, time, round);
    rows_.push_back(row);
    origins_.push_back(origin);
    return true;
}

// Each corner, side and face has a number: 6 i of the point i, 6 i + 1..3 of the sides that begin there, 6 i
// + 4..5 of faces.
std::size_t FaceWork::feature(int sphere, const std::array<int, 3>& c, const std::array<double, 3>& w) const {
    const std::size_t first = at(sphere) * 6 * x.size();
    const bool upper = c[1] == c[0] + 1;  // the first triangle of a cell, or a link
    const int used = (w[0] != 0) + (w[1] != 0) + (w[2] != 0);
    for (std::size_t i = 0; i < 3; ++i)
        if (used == 1 && w[i] != 0) return first + 6 * at(c[i]);
    if (used == 3) return first + 6 * at(upper ? c[0] : c[2]) + (upper ? 4 : 5);
    if (w[2] == 0) return first + 6 * at(c[0]) + (upper ? 1 : 2);
    if (w[0] == 0) return first + 6 * at(upper ? c[1] : c[2]) + (upper ? 3 : 1);
    return first + 6 * at(c[0]) + (upper ? 2 : 3);
}

// The bounds of a row: the place arrives with the speed u at the surface and leaves it with e u. The
// acceleration a of the free step towards the sphere goes on. A place that would be back within the step
// stays at the surface.
void FaceWork::aim(ContactRow& row, Origin& origin, double depth, double time, int round) {
    const SweptSphere& s = (*spheres_)[at(origin.sphere)];
    const Shell& shell = shells_[at(origin.sphere)];
    const Vec3& n = row.normal;
    const double end = n.dot(row.at(v) - vec(s.velocity));
    if (depth <= 0) {
        row.speed.target += std::min(0.0, end) * n;
        return;
    }
    const double start = n.dot(row.at(v0) - vec(s.velocity));
    double pull = (start - n.dot(row.at(free_v_) - vec(s.velocity))) / s.dt;
    double left = (1 - time) * s.dt;
    if (round == 0) {
        const double gap =
            std::max(0.0, n.dot(row.at(broad_phase_.frame(origin.sphere).start)) - shell.surface);
        const double arrival2 = start < 0 || pull > 0 ? start * start + 2 * pull * gap : 0;
        origin.arrival = std::sqrt(std::max(0.0, arrival2));
        if (origin.arrival > 0)
            left = std::max(
                0.0,
                s.dt - (start < 0 ? 2 * gap / (origin.arrival - start) : (start + origin.arrival) / pull));
    } else {
        origin.arrival = std::max(0.0, -end);
    }
    const double bounce = s.restitution * origin.arrival;
    if (bounce <= 0) return;
    const double height = (bounce - pull * left / 2) * left;
    if (height > 0 && !grounded_) {
        origin.height = height;
        row.place.target += height * n;
        row.speed.target += (bounce - pull * left) * n;
    } else {
        row.speed.target += bounce * n;
    }
}

}  // namespace clothsim
