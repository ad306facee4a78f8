#include "contact/face_work.hpp"

#include <algorithm>
#include <cmath>

#include "contact/exact.hpp"

namespace clothsim {

using exact::vec;

namespace {

// Sweeps of a solve end when the change is this part of the largest lack, or at a number of sweeps or blocks.
// A small problem is solved in full, a large one goes on from its impulses in the next step.
// Half the blocks make more rounds, twice the blocks cost up to 1.5 times in folds.
struct Effort {
    double part;
    std::size_t blocks;
    int least, most;
};
constexpr Effort resting{1e-6, 2000, 10, 100};
// Of positions, which later rounds and the next step correct: they add no velocity. A tenth of the part costs
// a light drape 1.3 times more, and half the blocks save nothing, as they make more rounds.
constexpr Effort placing{1e-2, 1000, 3, 100};
constexpr Effort bouncing{1e-10, 20000, 100, 1000};  // of what flies for longer than a step: rare

}  // namespace

FaceWork::FaceWork(const Scene& scene, const std::vector<bool>& faces, const FaceKernels& kernels)
    : scene_(scene), cloth_(scene.cloth), faces_(faces), broad_phase_(cloth_, faces.size(), kernels) {
    const Cloth& cloth = scene.cloth;
    const std::size_t n = at(cloth.points());
    for (auto* a : {&x0, &v0, &x, &v, &scratch_}) a->resize(n);
    changed.resize(n);
    sum_.resize(n);
    seen_.resize(6 * n * faces.size(), 0);
    persistent_at_.resize(seen_.size(), 0);
    stiffness_.assign(n, 0.0);
    for (int i = 0; i < cloth.points(); ++i)
        for (const Neighbour& neighbour : neighbours) {
            const int r = i / cloth.columns + neighbour.row, c = i % cloth.columns + neighbour.column;
            if (cloth.present[neighbour.family] && r >= 0 && r < cloth.rows && c >= 0 && c < cloth.columns)
                stiffness_[at(i)] += cloth.stiffness[neighbour.family];
        }
    inside_.assign(faces.size(), std::vector<std::uint8_t>(2 * n, 0));
    followed_ = inside_;
}

Corners FaceWork::corners(const std::vector<Vec3>& of, const std::array<int, 3>& c) const {
    return {of[at(c[0])], of[at(c[1])], of[at(c[2])]};
}

// Where points are now, seen from a sphere.
const FaceWork::Frame& FaceWork::place_in_frame(int sphere) {
    return broad_phase_.place(sphere, (*spheres_)[at(sphere)].end, x);
}

void FaceWork::solve_side(std::size_t first, std::vector<Vec3>& z, ContactSide side, double tolerance,
                          double quiet, int most) {
    guess_impulses(rows_, first, z, sum_, side);
    solve_contacts(rows_, z, side, tolerance, most, memory_, *poll_, first, quiet);
}

// Positions or velocities. The rows before `first` are solved for already.
void FaceWork::solve(std::size_t first, ContactSide side) {
    const bool places = side == &ContactRow::place;
    const std::vector<Vec3>& free = places ? free_x_ : free_v_;
    double largest = 0, lacks = 0;
    for (std::size_t k = first; k < rows_.size(); ++k) {
        const Vec3 is = rows_[k].at(free);
        largest = std::max(largest, is.cwiseAbs().maxCoeff());
        lacks = std::max(lacks, rows_[k].normal.dot((rows_[k].*side).target - is));
    }
    constexpr double rounding = 0x1p-51;  // of the largest quantity; not tuned: a bound
    const bool flying = flies();
    const Effort& effort = flying ? bouncing : places ? placing : resting;
    double tolerance = effort.part * lacks + rounding * largest;
    // In later rounds, places need no more than the margin.
    const double quiet =
        places ? std::max(tolerance, (shells_[0].middle - shells_[0].inside) / 16) : tolerance;
    if (first > 0 && !flying) tolerance = quiet;
    const int most =
        std::clamp(int(effort.blocks / std::max<std::size_t>(rows_.size(), 1)), effort.least, effort.most);
    solve_side(first, places ? x : v, side, tolerance, quiet, most);
}

// Impulses to begin with, of the step before.
void FaceWork::restore_persistent(double dt) {
    if (persistent.empty()) return;
    std::erase_if(persistent, [this](const PersistentContact& l) {
        return l.feature >= persistent_at_.size();
    });  // of another scene
    for (std::size_t k = 0; k < persistent.size(); ++k)
        persistent_at_[persistent[k].feature] = std::uint32_t(k + 1);
    for (std::size_t k = 0; k < rows_.size(); ++k) {
        const std::uint32_t last = persistent_at_[origins_[k].feature];
        if (last == 0) continue;
        ContactRow& row = rows_[k];
        row.place.impulse = dt * dt * persistent[last - 1].place;
        row.speed.impulse = dt * persistent[last - 1].speed;
        row.push(x, row.place.impulse);
        row.push(v, row.speed.impulse);
    }
    for (const PersistentContact& l : persistent) persistent_at_[l.feature] = 0;
}

void FaceWork::save_persistent(double dt) {
    persistent.clear();
    for (std::size_t k = 0; k < rows_.size(); ++k) {
        const ContactRow& row = rows_[k];
        if ((row.place.impulse.array() == 0).all() && (row.speed.impulse.array() == 0).all()) continue;
        std::uint32_t& last = persistent_at_[origins_[k].feature];
        if (last == 0) {
            persistent.push_back({origins_[k].feature, Vec3::Zero(), Vec3::Zero()});
            last = std::uint32_t(persistent.size());
        }
        persistent[last - 1].place += row.place.impulse / (dt * dt);
        persistent[last - 1].speed += row.speed.impulse / dt;
    }
    for (const PersistentContact& l : persistent) persistent_at_[l.feature] = 0;
}

// Points and triangles inside at the start go outwards by at most the push of their sphere, and not inwards.
bool FaceWork::push_out(int sphere, const Triangle& t) {
    const SweptSphere& s = (*spheres_)[at(sphere)];
    const Shell& shell = shells_[at(sphere)];
    const Vec3 c0 = vec(s.start), c1 = vec(s.end);
    Corners p0 = corners(x0, t.corner), p1 = corners(x, t.corner);
    for (auto& c : p0) c -= c0;
    for (auto& c : p1) c -= c1;
    const Foot foot = nearest_to_origin(p1);
    const double distance = foot.point.norm(), began = nearest_to_origin(p0).point.norm();
    const double aim = std::min(shell.surface, began + s.push);
    if (distance >= aim) return false;
    const Vec3 n = outward_normal(foot.point);
    std::array<double, 3> weight = foot.weight, part{0, 0, 0};
    for (std::size_t i = 1; i < 3; ++i)
        for (std::size_t j = 0; j < i; ++j)
            if (t.corner[i] == t.corner[j]) {
                weight[j] += weight[i];
                weight[i] = 0;
            }
    double mobility = 0;
    for (std::size_t i = 0; i < 3; ++i)
        if (!cloth_.pinned[at(t.corner[i])])
            mobility += weight[i] * (part[i] = weight[i] / cloth_.mass[at(t.corner[i])]);
    if (mobility <= 0) {
        if (distance < s.radius) report_.note_pinned(pinned_corner(t.corner));
        return false;
    }
    Vec3 velocity = -vec(s.velocity);
    double lift = aim - distance;
    for (std::size_t i = 0; i < 3; ++i) {
        part[i] /= mobility;
        velocity += weight[i] * v[at(t.corner[i])];
        double& pushed = pushed_[at(t.corner[i])];
        if (part[i] > 0) lift = std::min(lift, (s.push - pushed) / part[i]);  // no faster for being shared
    }
    const double inwards = std::min(velocity.dot(n), 0.0);
    if (lift <= 1e-3 * s.push && inwards == 0) return false;
    lift = std::max(lift, 0.0);
    for (std::size_t i = 0; i < 3; ++i) {
        if (part[i] == 0) continue;
        const std::size_t c = at(t.corner[i]);
        pushed_[c] += part[i] * lift;
        x[c] += part[i] * lift * n;
        v[c] -= part[i] * inwards * n;
    }
    further_work_ -= inwards / mobility * n.dot(vec(s.velocity));
    for (std::size_t i = 0; i < 3; ++i)
        further_[at(sphere)] -= cloth_.mass[at(t.corner[i])] * part[i] * inwards * n;
    return true;
}

void FaceWork::push_out_all() {
    constexpr int sweeps = 200;  // not tuned: a bound, the loop ends at rest
    pushed_.assign(x.size(), 0.0);
    for (int k = 0; k < sweeps; ++k) {
        bool moved = false;
        for (const auto& [sphere, triangle] : starts_inside_) moved |= push_out(sphere, triangle);
        poll_->passed(pieces_of_touch * starts_inside_.size());
        if (!moved) return;
    }
}

void FaceWork::note_changed() {
    for (std::size_t i = 0; i < x.size(); ++i) changed[i] = x[i] != free_x_[i] || v[i] != free_v_[i];
}

// Rows for what the ways reach, until they reach nothing. A bounce asks for the speed of arrival, so that
// velocities are solved for too before the next round; else once at the end.
bool FaceWork::follow_ways(int first_round) {
    std::size_t slow = first_round > 0 ? rows_.size() : 0;  // rows whose velocities are solved for
    bool clear = false;
    for (int round = first_round; round < most_rounds && !clear; ++round) {
        const std::size_t before = rows_.size();
        clear = !find_rows(round);
        if (clear) break;
        if (round == 0) restore_persistent((*spheres_)[0].dt);
        solve(before, &ContactRow::place);
        bool bounces = false;
        for (std::size_t k = before; k < rows_.size(); ++k)
            bounces |= (*spheres_)[at(origins_[k].sphere)].restitution > 0;
        if (!bounces) continue;
        solve(slow, &ContactRow::speed);
        slow = rows_.size();
    }
    follow_feet();
    solve(0, &ContactRow::speed);
    return clear;
}

ContactReport FaceWork::run(const std::vector<SweptSphere>& spheres, Poll& poll) {
    spheres_ = &spheres;
    poll_.emplace(poll);
    report_ = {};
    touched = false;
    rows_.clear();
    origins_.clear();
    for (const auto& [sphere, triangle] : starts_inside_) inside_[at(sphere)][triangle.number] = 0;
    starts_inside_.clear();
    shells_.clear();
    for (const SweptSphere& s : spheres) {
        const double margin = face_margin * s.radius + 4 * s.slop;
        shells_.push_back({s.radius, s.radius + margin / 2, s.radius + margin, s.radius + 2 * margin});
    }
    for (int s = 0; s < int(spheres.size()); ++s) broad_phase_.begin(s, spheres[at(s)].start, x0);
    free_x_ = x;
    free_v_ = v;
    grounded_ = false;
    bool clear = follow_ways(0);
    if (!restore_speeds()) {
        ground();
        clear = follow_ways(1);
        restore_speeds();
    }
    if (!clear) {
        const std::size_t kept = rows_.size();
        if (project(all_sweeps)) solve_side(kept, v, &ContactRow::speed, 1e-12, 0, all_sweeps.most);
    }
    if (!starts_inside_.empty()) push_out_all();
    Fault fault = fault_of_place();
    if (fault.point >= 0) fault = search(fault);
    if (fault.point >= 0) report_.note_fault(fault.point, fault.energy);
    note_given();
    save_persistent(spheres[0].dt);
    return report_;
}

bool keeps_persistent(const Scene& before, const Scene& after, double t) {
    const auto continuous = [](const Scene& scene) {
        std::vector<const Sphere*> found;
        for (const Sphere& sphere : scene.spheres)
            if (sphere.response == Response::continuous) found.push_back(&sphere);
        return found;
    };
    const std::vector<const Sphere*> old = continuous(before), now = continuous(after);
    const auto same = [&](std::size_t i, std::size_t k) {
        return old[i]->radius == now[k]->radius && old[i]->center_at(t) == now[k]->center_at(t);
    };
    if (old.size() != now.size()) return false;
    for (std::size_t k = 0; k < now.size(); ++k) {
        if (old[k]->faces != now[k]->faces) return false;
        for (std::size_t i = 0; i < old.size(); ++i)
            if (same(i, k) && !same(k, k)) return false;  // a sphere has another number than before
    }
    return true;
}

std::unique_ptr<FacePass> make_face_pass(const Scene& scene, const std::vector<bool>& faces,
                                         const FaceKernels& kernels) {
    return std::make_unique<FaceWork>(scene, faces, kernels);
}

}  // namespace clothsim
