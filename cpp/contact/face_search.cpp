// Where the rows of the paths do not end a step: other ways to a place, and the check of the place.
#include <algorithm>
#include <cmath>
#include <limits>

#include "contact/exact.hpp"
#include "contact/face_work.hpp"

namespace clothsim {

using exact::vec;

// Rows at the places that are nearest at the end, and at places that are deepest on a path that ends outside.
// True: a place is below the middle of the margin.
bool FaceWork::place_rows() {
    // Of the surface's radius: a place further off gets no row. Found by drapes: half or twice the excess of
    // 0.2 changes neither states nor time, as places that far are no contacts.
    constexpr double far = 1.2;
    bool low = false;
    ++inspection_;
    broad_phase_.note_drift(x, free_x_);
    for (int s = 0; s < int(spheres_->size()); ++s) {
        const Frame& frame = place_in_frame(s);
        const Shell& shell = shells_[at(s)];
        const auto add = [&](const Triangle& t, const Foot& foot, double time) {
            const double distance = foot.point.norm();
            if (distance > far * shell.surface || distance == 0) return;
            if (!add_row(s, t, foot, foot.point / distance, time, most_rounds)) return;
            rows_.back().speed.target = vec((*spheres_)[at(s)].velocity);
            low |= distance < shell.middle;
        };
        if (!faces_[at(s)]) {
            for (int i = 0; i < cloth_.points(); ++i)
                if (!inside_[at(s)][at(i)]) add({{i, i, i}, at(i)}, {Frame::at(frame.end, i), {1, 0, 0}}, 0);
            continue;
        }
        broad_phase_.each_open(s, far * shell.surface, FaceBroadPhase::Pass::all, [&](const Triangle& t) {
            poll_->passed(pieces_of_touch);
            if (inside_[at(s)][t.number]) return;
            const Corners p0 = Frame::corners(frame.start, t.corner),
                          p1 = Frame::corners(frame.end, t.corner);
            const Foot last = nearest_to_origin(p1);
            const double tolerance = (shell.middle - shell.inside) / 16;
            if (last.point.norm() >= shell.middle && !broad_phase_.separated(s, t, shell.inside)) {
                const TriangleTouch first = triangle_touch(p0, p1, shell.inside, tolerance);
                const double time =
                    (first.time + 1 - triangle_touch(p1, p0, shell.inside, tolerance).time) / 2;
                if (first.hit && time > 0) return add(t, nearest_to_origin(corners_at(p0, p1, time)), time);
            }
            add(t, last, 0);
        });
    }
    return low;
}

// Rows are placed and their positions solved for, again and again until no place is low.
bool FaceWork::project(const Sweeps& sweeps) {
    // Of the margin; places need not be exact while new rows are still found. Half costs up to a tenth of the
    // pass; twice gains nothing.
    constexpr double accuracy = 1e-3;
    const std::size_t kept = rows_.size();
    for (int k = 0; k < sweeps.rounds; ++k) {
        rows_.resize(kept);
        origins_.resize(kept);
        if (!place_rows()) return true;
        std::vector<ContactRow> rows(rows_.begin() + std::ptrdiff_t(kept), rows_.end());
        for (ContactRow& row : rows) row.friction = 0;
        if (sweeps.most > 1) guess_impulses(rows, 0, x, sum_, &ContactRow::place);
        solve_contacts(rows, x, &ContactRow::place, accuracy * (shells_[0].surface - shells_[0].inside),
                       sweeps.most, memory_, *poll_);
    }
    return false;
}

// Positions from which a projection may find a place: where the free step ends; the sheet as each sphere
// would carry it; the sheet halfway to the plane between each two spheres, and flat on it.
std::vector<std::vector<Vec3>> FaceWork::starts() const {
    std::vector<std::vector<Vec3>> starts{free_x_};
    const auto add = [&](const auto& move) {
        starts.push_back(x0);
        for (std::size_t i = 0; i < x0.size(); ++i)
            if (!cloth_.pinned[i]) starts.back()[i] += move(x0[i]);
    };
    for (const SweptSphere& s : *spheres_) add([&](const Vec3&) { return Vec3(vec(s.end) - vec(s.start)); });
    for (const SweptSphere& a : *spheres_)
        for (const SweptSphere& b : *spheres_) {
            if (&b <= &a) continue;
            const Vec3 way = vec(b.end) - vec(a.end);
            const double length = way.norm(), height = (length + a.radius - b.radius) / 2;
            if (length == 0) continue;
            for (const double part : {0.5, 1.0})
                add([&](const Vec3& p) {
                    return Vec3(part * (height - (p - vec(a.end)).dot(way) / length) / length * way);
                });
        }
    return starts;
}

// The point of an intersection of half-spaces that is nearest to p. False: the intersection is empty.
//
// The nearest point lies on at most three of the planes, so all sets of up to three are tried.
bool FaceWork::nearest_in(const std::vector<HalfSpace>& all, int point, Vec3& nearest) const {
    const Vec3 &p = free_x_[at(point)], &start = x0[at(point)];
    double size = p.cwiseAbs().sum() + start.cwiseAbs().sum();
    for (const SweptSphere& s : *spheres_) size += (vec(s.end) - vec(s.start)).cwiseAbs().sum();
    const double rounding = 0x1p-51 * size;
    double least = std::numeric_limits<double>::infinity();
    const auto offer = [&](const Vec3& q) {
        const double distance2 = (q - p).squaredNorm();
        if (!(distance2 < least)) return;
        for (const HalfSpace& h : all)
            if (h.normal.dot(q) < h.level - rounding) return;
        least = distance2;
        nearest = q;
    };
    // Squared sine below which two planes count as one: far above the rounding of a normal, 1e-16. Half or
    // twice changes nothing.
    constexpr double parallel = 1e-12;
    offer(p);
    for (const SweptSphere& s : *spheres_) offer(start + (vec(s.end) - vec(s.start)));
    for (std::size_t i = 0; i < all.size(); ++i) {
        const HalfSpace& a = all[i];
        offer(p + (a.level - a.normal.dot(p)) * a.normal);
        for (std::size_t j = 0; j < i; ++j) {
            const HalfSpace& b = all[j];
            const Vec3 line = a.normal.cross(b.normal);
            const double sine2 = line.squaredNorm();
            if (sine2 < parallel) continue;
            const double cosine = a.normal.dot(b.normal), from_a = a.level - a.normal.dot(p),
                         from_b = b.level - b.normal.dot(p);
            offer(p +
                  ((from_a - cosine * from_b) * a.normal + (from_b - cosine * from_a) * b.normal) / sine2);
            for (std::size_t k = 0; k < j; ++k) {
                const HalfSpace& c = all[k];
                const double volume = line.dot(c.normal);
                if (volume * volume < parallel * sine2) continue;
                offer((a.level * b.normal.cross(c.normal) + b.level * c.normal.cross(a.normal) +
                       c.level * line) /
                      volume);
            }
        }
    }
    return least < std::numeric_limits<double>::infinity();
}

// The sheet as the spheres push it. At the start of the step, take the plane across the shortest way from a
// sphere to a triangle. It moves with the sphere. All corners stay behind it, so no path of theirs touches
// the sphere. One sphere alone always leaves such a place, as all corners may move with it. Each corner goes
// to the nearest.
bool FaceWork::move_with_spheres() {
    // Bounds; a point has more planes only between spheres that close. Half or twice of either changes no
    // drape and no shot.
    constexpr int most_planes = 40;
    constexpr int most_rounds_of_planes = 50;
    std::vector<std::vector<HalfSpace>> planes(x.size());
    std::vector<std::vector<std::uint8_t>> held(spheres_->size(), std::vector<std::uint8_t>(2 * x.size(), 0));
    x = free_x_;
    for (int round = 0; round < most_rounds_of_planes; ++round) {
        std::vector<std::size_t> moved;
        each_blocked([&](int s, const Triangle& t) {
            std::uint8_t& known = held[at(s)][t.number];
            if (known) return;
            known = 1;
            const SweptSphere& sphere = (*spheres_)[at(s)];
            const Vec3 foot = nearest_to_origin(Frame::corners(broad_phase_.frame(s).start, t.corner)).point;
            const Vec3 n = outward_normal(foot);
            const Shell& shell = shells_[at(s)];
            const double level =
                n.dot(vec(sphere.end)) + std::clamp(foot.norm(), shell.inside, shell.surface);
            for (std::size_t i = 0; i < 3; ++i) {
                if (i > 0 && t.corner[i] == t.corner[i - 1]) continue;
                planes[at(t.corner[i])].push_back({n, level});
                moved.push_back(at(t.corner[i]));
            }
        });
        if (moved.empty()) return true;
        for (const std::size_t i : moved) {
            if (cloth_.pinned[i]) continue;
            poll_->passed(planes[i].size() * planes[i].size() * planes[i].size() / 8);
            if (planes[i].size() > most_planes || !nearest_in(planes[i], int(i), x[i])) return false;
        }
    }
    return false;
}

int FaceWork::nearest_sphere(const Vec3& place) const {
    const auto distance = [&](const SweptSphere& s) { return (place - vec(s.end)).norm() - s.radius; };
    return int(std::min_element(
                   spheres_->begin(), spheres_->end(),
                   [&](const SweptSphere& a, const SweptSphere& b) { return distance(a) < distance(b); }) -
               spheres_->begin());
}

// A point that a search has moved gets the velocity of its path. Seen from the sphere next to it, the point
// gets no faster than in the free step: a wall works with its own velocity alone. Spheres that close squeeze
// a point out sideways and stretch its springs. The impulse that moves it there bounds their work.
void FaceWork::take_path_speeds() {
    const double dt = (*spheres_)[0].dt;
    double fastest = 0;
    for (const SweptSphere& s : *spheres_) fastest = std::max(fastest, vec(s.velocity).norm());
    further_work_ = 0;
    further_.assign(spheres_->size(), Vec3(0, 0, 0));
    for (std::size_t i = 0; i < x.size(); ++i) {
        v[i] = free_v_[i];
        if (x[i] == free_x_[i]) continue;
        const int sphere = nearest_sphere(x[i]);
        const Vec3 wall = vec((*spheres_)[at(sphere)].velocity), path = (x[i] - x0[i]) / dt - wall;
        const double speed = path.norm(), most = (free_v_[i] - wall).norm();
        v[i] = wall + (speed > most ? most / speed : 1.0) * path;
        const Vec3 change = v[i] - free_v_[i];
        further_work_ += cloth_.mass[i] * std::max(change.norm(), (x[i] - free_x_[i]).norm() / dt) * fastest;
        further_[at(sphere)] += cloth_.mass[i] * change;
    }
}

// Another place without a fault: the first within the ways of spheres and cloth, else the nearest to the free
// step. Such places have no contacts for the next step to begin with.
FaceWork::Fault FaceWork::search(Fault fault) {
    std::vector<Vec3> nearest;
    double least = std::numeric_limits<double>::infinity();
    const auto leave_contacts = [&] {
        rows_.clear();
        origins_.clear();
        take_path_speeds();
    };
    const auto is_near = [&] {
        leave_contacts();
        const Fault next = fault_of_place();
        if (fault.energy == 0) fault = next;
        if (next.point >= 0) return false;
        double far = 0;
        for (std::size_t i = 0; i < x.size(); ++i) far = std::max(far, (x[i] - free_x_[i]).norm());
        if (far < least) least = far, nearest = x;
        return far <= longest_ways();
    };
    if (move_with_spheres() && is_near()) return {};
    for (const Sweeps& sweeps : {single_sweeps, all_sweeps})
        for (const std::vector<Vec3>& start : starts()) {
            rows_.clear();
            origins_.clear();
            x = start;
            if (project(sweeps) && is_near()) return {};
        }
    if (nearest.empty()) return fault;
    x = nearest;
    leave_contacts();
    note_changed();
    return {};
}

// Triangles and points whose paths lead through a sphere or leave them inside it. A plane that turns beside a
// path proves it clear, whatever chose the plane.
template <class Visit>
void FaceWork::each_blocked(Visit visit) {
    broad_phase_.note_drift(x, free_x_);
    for (int s = 0; s < int(spheres_->size()); ++s) {
        const Frame& frame = place_in_frame(s);
        const double slop = (*spheres_)[at(s)].slop, reach = shells_[at(s)].inside - slop;
        if (faces_[at(s)]) {
            broad_phase_.each_open(s, reach, FaceBroadPhase::Pass::all, [&](const Triangle& t) {
                poll_->passed(pieces_of_touch);
                if (inside_[at(s)][t.number]) return;
                const Corners p0 = Frame::corners(frame.start, t.corner),
                              p1 = Frame::corners(frame.end, t.corner);
                const TriangleTouch touch = triangle_touch(p0, p1, reach, slop / 2);
                broad_phase_.set_plane(s, t, touch);
                if (touch.hit) visit(s, t);
            });
            continue;
        }
        for (int i = 0; i < cloth_.points(); ++i) {
            const Vec3 p0 = Frame::at(frame.start, i), q = Frame::at(frame.end, i) - p0;
            const double a = q.squaredNorm(), closest = a > 0 ? std::clamp(-p0.dot(q) / a, 0.0, 1.0) : 0.0;
            if (!inside_[at(s)][at(i)] && (p0 + closest * q).norm() < reach)
                visit(s, Triangle{{i, i, i}, at(i)});
        }
    }
}

// A free point of what is blocked, or -1.
int FaceWork::unresolved() {
    int found = -1;
    each_blocked([&](int, const Triangle& t) {
        const int held = pinned_corner(t.corner);
        if (held >= 0) report_.note_pinned(held);
        else if (found < 0) found = t.corner[0];
    });
    return found;
}

// The ways of the spheres and of the cloth in the step [m], twice for bounces.
double FaceWork::longest_ways() const {
    double ways = 0, own2 = 0;
    for (const SweptSphere& s : *spheres_) ways += (vec(s.end) - vec(s.start)).norm() + s.push;
    for (std::size_t i = 0; i < x.size(); ++i)
        if (changed[i]) own2 = std::max(own2, (free_x_[i] - x0[i]).squaredNorm());
    return 2 * (ways + std::sqrt(own2));
}

// No law of contact moves a point farther than this [m] from the end of the free step.
double FaceWork::farthest_place() const {
    double radius = 0;
    for (const SweptSphere& s : *spheres_) radius = std::max(radius, s.radius);
    return longest_ways() + radius;
}

// The most that contact may change a velocity [m/s]. A sphere's speed may act on a corner by the least lever
// beside a pin. The speeds of corners themselves act by at most 3, the lever of equal masses. A light corner
// beside a heavy one goes faster by the root of their ratio. Rows that contradict each other beside a pin or
// between spheres make more, although every place is sound.
double FaceWork::largest_speed_change() const {
    double own2 = 0, of_sphere = 0, restitution = 0;
    for (const SweptSphere& s : *spheres_) {
        const double travels = (vec(s.end) - vec(s.start)).norm() / s.dt;
        of_sphere = std::max({of_sphere, travels, vec(s.velocity).norm()});
        restitution = std::max(restitution, s.restitution);
    }
    double heaviest = 0, lightest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < x.size(); ++i) {
        if (!changed[i]) continue;
        own2 = std::max({own2, v0[i].squaredNorm(), free_v_[i].squaredNorm()});
        heaviest = std::max(heaviest, cloth_.mass[i]);
        lightest = std::min(lightest, cloth_.mass[i]);
    }
    const double unequal = heaviest > 0 ? std::sqrt(heaviest / lightest) : 1;
    return (1 + restitution) * unequal * (of_sphere / least_lever + 3 * std::sqrt(own2));
}

FaceWork::Fault FaceWork::fault_of_place() {
    note_changed();
    const int stuck = unresolved();
    if (stuck >= 0) return {stuck, 0};
    const double farthest = farthest_place();
    int fastest = -1;
    double most = -1;
    for (int i = 0; i < cloth_.points(); ++i) {
        if (!changed[at(i)]) continue;
        if (!((x[at(i)] - free_x_[at(i)]).squaredNorm() <= farthest * farthest)) return {i, 0};
        const double speed2 = (v[at(i)] - free_v_[at(i)]).squaredNorm();
        if (speed2 > most) most = speed2, fastest = i;
    }
    const double excess = energy_made() - most_energy_made(), most_change = largest_speed_change();
    if (excess > 0) return {fastest, excess};
    return most > most_change * most_change ? Fault{fastest, 0} : Fault{};
}

}  // namespace clothsim
