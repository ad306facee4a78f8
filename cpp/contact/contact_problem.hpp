// The contact problem: impulses that keep places of the cloth outside spheres, within Coulomb's cone, all at
// once.
//
// A row is a place of the cloth, a weighted mean of up to three corners, against one sphere with the normal
// n. With z the positions or the velocities of the corners, y = sum(w z) at the place and an impulse P of the
// sphere there,
//
//     z_i = z_i(free) + w_i/m_i P        n.(y - target) >= 0,  n.P >= 0,  one of the two 0
//     |P_t| <= mu n.P, and P_t is what leaves y_t = target_t if the cone holds it, else opposed to y_t -
//     target_t
//
// Block Gauss-Seidel with projection on the cone solves it (Jean 1999, nonsmooth contact dynamics; Moreau
// 1988 for the law). The block of a row is sum(w^2/m) times the unit matrix, so each block is solved exactly.
// The start is impulses that would be right if all rows with common corners were alike.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "memory/poll.hpp"
#include "model/sphere.hpp"

namespace clothsim {

struct ContactRow {
    std::array<int, 3> corner;
    std::array<double, 3> weight, part;  // part: weight / mass, 0 if the corner is pinned [1/kg]
    double mobility, inertia;  // sum of weight * part [1/kg], and its inverse [kg]
    double friction;
    Vec3 normal;
    struct Side {
        Vec3 target = Vec3::Zero();  // n.target: the bound; the rest: where a place that sticks is
        Vec3 impulse = Vec3::Zero();
    };
    Side place;  // of positions [m], impulses in kg m
    Side speed;  // of velocities [m/s], impulses in N s

    Vec3 at(const std::vector<Vec3>& z) const {
        return weight[0] * z[std::size_t(corner[0])] + weight[1] * z[std::size_t(corner[1])] +
            weight[2] * z[std::size_t(corner[2])];
    }
    Vec3 at(const std::array<std::vector<double>, 3>& z) const {
        Vec3 y;
        for (std::size_t k = 0; k < 3; ++k)
            y[Eigen::Index(k)] = weight[0] * z[k][std::size_t(corner[0])] +
                weight[1] * z[k][std::size_t(corner[1])] + weight[2] * z[k][std::size_t(corner[2])];
        return y;
    }
    void push(std::vector<Vec3>& z, const Vec3& impulse) const {
        for (std::size_t i = 0; i < 3; ++i)
            if (part[i] != 0) z[std::size_t(corner[i])] += part[i] * impulse;
    }
};

using ContactSide = ContactRow::Side ContactRow::*;

// Impulses to begin with where there is none yet, of the rows from `first` on.
inline void guess_impulses(std::vector<ContactRow>& rows, std::size_t first, std::vector<Vec3>& z,
                           std::vector<double>& sum, ContactSide side) {
    const auto none = [&](const ContactRow& row) { return ((row.*side).impulse.array() == 0).all(); };
    for (std::size_t k = first; k < rows.size(); ++k)
        for (const int i : rows[k].corner) sum[std::size_t(i)] = 0;
    for (std::size_t k = first; k < rows.size(); ++k)
        if (none(rows[k]))
            for (std::size_t i = 0; i < 3; ++i) sum[std::size_t(rows[k].corner[i])] += rows[k].weight[i];
    std::vector<std::size_t> begun;
    for (std::size_t k = first; k < rows.size(); ++k) {
        ContactRow& row = rows[k];
        const double lacks = none(row) ? row.normal.dot((row.*side).target - row.at(z)) : 0;
        if (lacks <= 0) continue;
        double mobility = 0;
        for (std::size_t i = 0; i < 3; ++i) mobility += row.part[i] * sum[std::size_t(row.corner[i])];
        (row.*side).impulse = lacks / mobility * row.normal;
        begun.push_back(k);
    }
    for (const std::size_t k : begun) rows[k].push(z, (rows[k].*side).impulse);
}

// One row; by how much its impulse changed.
inline Vec3 solve_block(ContactRow& row, std::vector<Vec3>& z, ContactSide side) {
    ContactRow::Side& s = row.*side;
    Vec3 next = s.impulse + row.inertia * (s.target - row.at(z));
    const double along = next.dot(row.normal);
    if (along <= 0) {
        next.setZero();
    } else if (row.friction == 0) {
        next = along * row.normal;
    } else {
        const Vec3 across = next - along * row.normal;
        const double most = row.friction * along, length2 = across.squaredNorm();
        if (length2 > most * most) next = along * row.normal + (most / std::sqrt(length2)) * across;
    }
    const Vec3 change = next - s.impulse;
    s.impulse = next;
    row.push(z, change);
    return change;
}

// Data of a solver beside rows and points.
struct SolverMemory {
    std::vector<Vec3> change, direction;  // of the impulses, by the newest sweep; by all before
    std::vector<int> swept;  // rows: in which sweep last
    std::vector<int> moved;  // points: in which sweep last
};

// Sweeps to and fro over the rows until none changes its place by more than `tolerance`, at most so many; how
// many it took. The rows before `first` are solved for already: they join in once a point of theirs moves by
// more than `quiet`.
//
// Between two sweeps the impulses go on along the directions of earlier sweeps, as in conjugate gradients.
// The change by a sweep stands for the negative gradient (Silcowitz-Hansen, Niebe, Erleben 2010, nonsmooth
// nonlinear conjugate gradients after Fletcher and Reeves). A sweep makes every result, so every result is in
// the cones.
inline int solve_contacts(std::vector<ContactRow>& rows, std::vector<Vec3>& z, ContactSide side,
                          double tolerance, int most, SolverMemory& memory, CountedPoll& poll,
                          std::size_t first = 0, double quiet = 0) {
    const std::size_t count = rows.size();
    memory.change.resize(count);
    memory.direction.resize(count);
    memory.swept.assign(count, -1);
    memory.moved.resize(z.size());
    if (first > 0)
        for (const ContactRow& row : rows)
            for (const int i : row.corner) memory.moved[std::size_t(i)] = -1;
    const auto note = [&](const ContactRow& row, double size, int sweep) {
        if (first > 0 && size > quiet)
            for (const int i : row.corner) memory.moved[std::size_t(i)] = sweep;
    };
    double changed = 0, squares = 0;  // squares: in the norm of energy
    const auto visit = [&](std::size_t k, int sweep) {
        ContactRow& row = rows[k];
        if (k < first) {
            int moved = -1;
            for (const int i : row.corner) moved = std::max(moved, memory.moved[std::size_t(i)]);
            if (moved < std::max(sweep - 1, 0)) return;
        }
        const Vec3 change = solve_block(row, z, side);
        const double size = change.cwiseAbs().maxCoeff() * row.mobility;
        if (memory.swept[k] < sweep - 1 || sweep == 0) memory.direction[k].setZero();
        memory.swept[k] = sweep;
        memory.change[k] = change;
        changed = std::max(changed, size);
        squares += row.mobility * change.squaredNorm();
        note(row, size, sweep);
    };
    double last = 0;
    for (int sweep = 0; sweep < most; ++sweep) {
        poll.passed(count);
        changed = squares = 0;
        if (sweep % 2 == 0)
            for (std::size_t k = count; k-- > 0;) visit(k, sweep);
        else
            for (std::size_t k = 0; k < count; ++k) visit(k, sweep);
        if (changed <= tolerance) return sweep + 1;
        if (sweep + 1 == most) break;
        const double ratio = last > 0 && squares <= last ? squares / last : 0;
        last = squares;
        for (std::size_t k = 0; k < count; ++k) {
            if (memory.swept[k] != sweep) continue;
            if (ratio == 0) {
                memory.direction[k] = memory.change[k];
                continue;
            }
            const Vec3 further = ratio * memory.direction[k];
            (rows[k].*side).impulse += further;
            rows[k].push(z, further);
            note(rows[k], further.cwiseAbs().maxCoeff() * rows[k].mobility, sweep);
            memory.direction[k] = further + memory.change[k];
        }
    }
    return most;
}

}  // namespace clothsim
