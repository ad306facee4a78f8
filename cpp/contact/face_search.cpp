// Where the rows of the paths do not end a step: other ways to a place, and the check of the place.
#include <algorithm>
#include <cmath>

#include "contact/exact.hpp"
#include "contact/face_work.hpp"

namespace clothsim {

using exact::vec;

// Rows at the places that are nearest at the end, and at places that are deepest on a path that ends outside.
// True: a place is below the middle of the margin.
bool FaceWork::place_rows() {
    constexpr double far = 1.2;  // of the radius: a place further off than this gets no row
    bool low = false;
    ++inspection_;
    note_drift();
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
        each_open_triangle(s, far * shell.surface, most_rounds, [&](const Triangle& t) {
            if (inside_[at(s)][t.number]) return;
            const Corners p0 = Frame::corners(frame.start, t.corner),
                          p1 = Frame::corners(frame.end, t.corner);
            const Foot last = nearest_to_origin(p1);
            const double tolerance = (shell.middle - shell.inside) / 16;
            if (last.point.norm() >= shell.middle && !separated(s, t, shell.inside)) {
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

// Rows are placed and their positions solved for, again and again until no place is low. Then velocities are.
bool FaceWork::project(const Sweeps& sweeps) {
    constexpr double accuracy = 1e-3;  // of the margin
    const std::size_t kept = rows_.size();
    for (int k = 0; k < sweeps.rounds; ++k) {
        rows_.resize(kept);
        origins_.resize(kept);
        if (!place_rows()) {
            solve_side(kept, v, &ContactRow::speed, 1e-12, 0, all_sweeps.most);
            return true;
        }
        std::vector<ContactRow> rows(rows_.begin() + std::ptrdiff_t(kept), rows_.end());
        for (ContactRow& row : rows) row.friction = 0;
        if (sweeps.most > 1) guess_impulses(rows, 0, x, sum_, &ContactRow::place);
        solve_contacts(rows, x, &ContactRow::place, accuracy * (shells_[0].surface - shells_[0].inside),
                       sweeps.most, memory_);
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

bool FaceWork::search() {
    const std::size_t kept = rows_.size();
    const std::vector<Vec3> speeds = v;
    for (const Sweeps& sweeps : {single_sweeps, all_sweeps})
        for (const std::vector<Vec3>& start : starts()) {
            rows_.resize(kept);
            origins_.resize(kept);
            x = start;
            v = speeds;
            const bool found = project(sweeps);
            if (found && unresolved() < 0) return true;
        }
    return false;
}

// A free point of what the paths lead through a sphere or leave inside it, or -1. A plane that turns beside a
// path proves it clear, whatever chose the plane.
int FaceWork::unresolved() {
    int found = -1;
    note_drift();
    for (int s = 0; s < int(spheres_->size()); ++s) {
        const Frame& frame = place_in_frame(s);
        const double slop = (*spheres_)[at(s)].slop, reach = shells_[at(s)].inside - slop;
        const auto note = [&](const std::array<int, 3>& corner) {
            const int held = pinned_corner(corner);
            if (held >= 0) report_.note_pinned(held);
            else if (found < 0) found = corner[0];
        };
        if (faces_[at(s)]) {
            each_open_triangle(s, reach, most_rounds, [&](const Triangle& t) {
                if (inside_[at(s)][t.number]) return;
                const Corners p0 = Frame::corners(frame.start, t.corner),
                              p1 = Frame::corners(frame.end, t.corner);
                const TriangleTouch touch = triangle_touch(p0, p1, reach, slop / 2);
                set_plane(s, t, touch);
                if (touch.hit) note(t.corner);
            });
            continue;
        }
        for (int i = 0; i < cloth_.points(); ++i) {
            const Vec3 p0 = Frame::at(frame.start, i), q = Frame::at(frame.end, i) - p0;
            const double a = q.squaredNorm(), closest = a > 0 ? std::clamp(-p0.dot(q) / a, 0.0, 1.0) : 0.0;
            if (!inside_[at(s)][at(i)] && (p0 + closest * q).norm() < reach) note({i, i, i});
        }
    }
    return found;
}

}  // namespace clothsim
