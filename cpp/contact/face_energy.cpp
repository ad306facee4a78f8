// The energy of what bounces.
#include "contact/face_work.hpp"

#include <algorithm>
#include <cmath>

#include "contact/exact.hpp"

namespace clothsim {

using exact::vec;

double FaceWork::elastic_change() const {
    double change = 0;
    const int rows = cloth_.rows, columns = cloth_.columns;
    for (int i = 0; i < cloth_.points(); ++i) {
        if (!changed[at(i)]) continue;
        const int r = i / columns, c = i % columns;
        for (const Neighbour& n : neighbours) {
            if (!cloth_.present[n.family] || r + n.row < 0 || r + n.row >= rows || c + n.column < 0 ||
                c + n.column >= columns)
                continue;
            const int j = i + n.row * columns + n.column;
            if (changed[at(j)] && j < i) continue;  // once
            const double rest = cloth_.rest_length(n);
            const double is = (x[at(j)] - x[at(i)]).norm() - rest,
                         was = (free_x_[at(j)] - free_x_[at(i)]).norm() - rest;
            change += cloth_.stiffness[n.family] / 2 * (is - was) * (is + was);
        }
    }
    return change;
}

// Momentum that free corners take of an impulse; pins take the rest.
Vec3 FaceWork::to_cloth(const ContactRow& row, const Vec3& impulse) const {
    double taken = 0;
    for (std::size_t i = 0; i < 3; ++i) taken += row.part[i] * cloth_.mass[at(row.corner[i])];
    return taken * impulse;
}

// The velocity that an impulse of the row works with.
Vec3 FaceWork::acted_on(const ContactRow& row, const std::vector<Vec3>& velocities) const {
    Vec3 mean = Vec3::Zero();
    for (std::size_t i = 0; i < 3; ++i)
        mean += row.part[i] * cloth_.mass[at(row.corner[i])] * velocities[at(row.corner[i])];
    return mean;
}

void FaceWork::note_given() {
    given = further_;
    for (std::size_t k = 0; k < rows_.size(); ++k)
        given[at(origins_[k].sphere)] += to_cloth(rows_[k], rows_[k].speed.impulse);
}

// Energy at the end beyond that of the free step and the work of moving spheres.
double FaceWork::energy_made() const {
    double made = elastic_change() - further_work_;
    for (std::size_t i = 0; i < x.size(); ++i)
        if (changed[i])
            made += cloth_.mass[i] *
                ((v[i] - free_v_[i]).dot(v[i] + free_v_[i]) / 2 -
                 scene_.field_at(int(i)).dot(x[i] - free_x_[i]));
    for (std::size_t k = 0; k < rows_.size(); ++k)
        made -= rows_[k].speed.impulse.dot(vec((*spheres_)[at(origins_[k].sphere)].velocity));
    return made;
}

// The bound of that energy [J]. Springs may take up what a point and the spheres move within the step: the
// forces of a step do not know of it yet. The rest is the accuracy of places and impulses, and rounding.
double FaceWork::most_energy_made() const {
    // Part of the kinetic energy. Impulses of a step round by 1e-13 of it. Half or twice changes no step of
    // the fuzzers, as a fault makes more than a thousandth.
    constexpr double rounding = 1e-11;
    // Of the energy of the velocity changes, as triangles that rock together share corners. 2,000 shots,
    // drapes and squeezes need less than 1e-5 or, at fault, 9e-4 and more: half or twice changes none.
    constexpr double accuracy = 1e-4;
    double ways = 0, margin = 0, most = 0;
    for (std::size_t k = 0; k < spheres_->size(); ++k) {
        const SweptSphere& s = (*spheres_)[k];
        ways += (vec(s.end) - vec(s.start)).norm() + s.push;
        margin = std::max(margin, shells_[k].near - shells_[k].inside);
    }
    for (std::size_t i = 0; i < x.size(); ++i) {
        if (!changed[i]) continue;
        const double way = ways + margin + (free_x_[i] - x0[i]).norm();
        const double force = cloth_.mass[i] * (free_v_[i] - v0[i]).norm() / (*spheres_)[0].dt;
        most += stiffness_[i] / 2 * way * way + force * margin +
            cloth_.mass[i] *
                (rounding * (v[i].squaredNorm() + free_v_[i].squaredNorm()) +
                 accuracy / 2 * (v[i] - free_v_[i]).squaredNorm());
    }
    return most;
}

// Lack of energy at the end: the energy of the free step less the present energy. The work of moving spheres
// is added, losses by restitution and friction are subtracted.
double FaceWork::energy_lacking() const {
    double lacks = -energy_made();
    for (std::size_t k = 0; k < rows_.size(); ++k) {
        const ContactRow& row = rows_[k];
        const SweptSphere& s = (*spheres_)[at(origins_[k].sphere)];
        const Vec3 wall = vec(s.velocity);
        const double along = row.speed.impulse.dot(row.normal);
        const Vec3 across = row.speed.impulse - along * row.normal;
        lacks -= (1 - s.restitution) / 2 * along * origins_[k].arrival;
        // Friction works on the mean of the velocities before and after it. At rest it acts throughout the
        // step. On impact it acts at the time of impact, and the free step has gone on since.
        const Origin& origin = origins_[k];
        const Vec3 began = acted_on(row, v0), ends = acted_on(row, v), flies = acted_on(row, free_v_);
        const Vec3 mean = origin.rests() ? Vec3((began + ends) / 2)
                                         : Vec3(began + origin.time * (flies - began) + (ends - flies) / 2);
        lacks += across.dot(mean - wall);
    }
    return lacks;
}

bool FaceWork::bounced() const {
    return std::any_of(origins_.begin(), origins_.end(), [this](const Origin& origin) {
        return origin.arrival > 0 && (*spheres_)[at(origin.sphere)].restitution > 0;
    });
}

// Whether something is off the surface again when the step ends.
bool FaceWork::flies() const {
    return std::any_of(origins_.begin(), origins_.end(),
                       [](const Origin& origin) { return origin.height > 0; });
}

// The impulses of bounces are scaled to balance the energy, by a factor between 0 and 2. Resting contacts get
// none of that energy. False: a flying point cannot get so far.
bool FaceWork::restore_speeds() {
    further_work_ = 0;
    further_.assign(spheres_->size(), Vec3(0, 0, 0));
    if (!bounced()) return true;
    note_changed();
    std::vector<Vec3>& change = scratch_;  // of velocities, by those impulses
    std::fill(change.begin(), change.end(), Vec3(0, 0, 0));
    std::vector<Vec3> bounces = further_;
    double first = 0, second = 0, work = 0;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
        const ContactRow& row = rows_[k];
        const SweptSphere& s = (*spheres_)[at(origins_[k].sphere)];
        if (s.restitution * origins_[k].arrival <= 0) continue;
        const double along = std::min(row.speed.impulse.dot(row.normal),
                                      (1 + s.restitution) * origins_[k].arrival * row.inertia);
        first += along * row.normal.dot(row.at(v) - vec(s.velocity));
        work += along * row.normal.dot(vec(s.velocity));
        row.push(change, along * row.normal);
        bounces[at(origins_[k].sphere)] += to_cloth(row, along * row.normal);
    }
    for (std::size_t i = 0; i < x.size(); ++i)
        if (changed[i]) second += cloth_.mass[i] * change[i].squaredNorm();
    if (!(second > 0) || !(first > 0)) return true;
    const double lacks = energy_lacking();
    const double root2 = first * first + 2 * second * lacks;
    const double part =
        std::clamp(root2 >= 0 ? 2 * lacks / (first + std::sqrt(root2)) : -first / second, -1.0, 1.0);
    for (std::size_t i = 0; i < x.size(); ++i)
        if (changed[i]) v[i] += part * change[i];
    further_work_ = part * work;
    for (std::size_t s = 0; s < bounces.size(); ++s) further_[s] = part * bounces[s];
    return root2 >= 0 || !flies();
}

// This bounce does not get so far: it is held at the surface.
void FaceWork::ground() {
    grounded_ = true;
    for (std::size_t k = 0; k < begun_.size(); ++k) {  // without what follow_feet changed
        begun_[k].place.impulse = rows_[k].place.impulse;
        begun_[k].speed.impulse = rows_[k].speed.impulse;
    }
    rows_ = begun_;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
        ContactRow& row = rows_[k];
        Origin& origin = origins_[k];
        if (origin.height == 0) continue;
        const SweptSphere& s = (*spheres_)[at(origin.sphere)];
        row.place.target -= origin.height * row.normal;
        row.speed.target = vec(s.velocity) + s.restitution * origin.arrival * row.normal;
        origin.height = 0;
    }
    x = free_x_;
    v = free_v_;
    for (ContactRow& row : rows_) {
        row.push(x, row.place.impulse);
        row.push(v, row.speed.impulse);
    }
    solve(0, &ContactRow::place);
    solve(0, &ContactRow::speed);
}

}  // namespace clothsim
