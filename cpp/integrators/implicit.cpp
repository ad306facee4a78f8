#include "integrators/implicit.hpp"

#include <cmath>

namespace clothsim {
namespace {

constexpr int most_iterations = 60;  // not tuned: bounds, beyond which a step counts as failed
constexpr int most_halvings = 12;
// Residual relative to its parts, which Newton's method reaches a few times above rounding.
constexpr double converged = 1e-14;

}  // namespace

ImplicitMidpoint::ImplicitMidpoint(const Scene& scene) : scene_(scene), cloth_(scene.cloth) {
    const Cloth& cloth = scene.cloth;
    unknown_.assign(std::size_t(cloth.points()), -1);
    for (int i = 0; i < cloth.points(); ++i)
        if (!cloth.pinned[std::size_t(i)]) unknown_[std::size_t(i)] = unknowns_++;
    mass_.resize(3 * unknowns_);
    for (int i = 0; i < cloth.points(); ++i)
        if (unknown_[std::size_t(i)] >= 0)
            mass_.segment<3>(3 * unknown_[std::size_t(i)]).setConstant(cloth.mass[std::size_t(i)]);
    Vector tension = Vector::Zero(3 * unknowns_);
    cloth.each_spring([&](int from, int to, const Neighbour& kind) {
        for (const int point : {from, to})
            if (const int k = unknown_[std::size_t(point)]; k >= 0)
                tension[3 * k] += cloth.stiffness[kind.family] * cloth.rest_length(kind);
    });
    tension_ = size(tension);
    matrix_.resize(3 * unknowns_, 3 * unknowns_);
}

double ImplicitMidpoint::size(const Vector& r) const {
    return std::sqrt((r.array().square() / mass_.array()).sum());
}

Vec3 ImplicitMidpoint::place(const Vector& values, int point) const {
    const int k = unknown_[std::size_t(point)];
    return k < 0 ? Vec3(v_.row(point)) : Vec3(values.segment<3>(3 * k));
}

template <class Visit>
void ImplicitMidpoint::each_contact(double h, const Vector& u, Visit visit) const {
    for (const PenaltyContact& contact : contacts_)
        for (int i = 0; i < cloth_.points(); ++i) {
            const int k = unknown_[std::size_t(i)];
            if (k < 0) continue;
            const Vec3 velocity = u.segment<3>(3 * k);
            visit(k, contact, Vec3(x_.row(i).transpose() + h / 2 * velocity), velocity);
        }
}

// M (u - v) - h/2 F(x + h/2 u, u)
auto ImplicitMidpoint::residual(double h, const Vector& u) const -> Vector {
    Vector r(3 * unknowns_);
    for (int i = 0; i < cloth_.points(); ++i) {
        const int k = unknown_[std::size_t(i)];
        if (k < 0) continue;
        const Vec3 here = u.segment<3>(3 * k);
        const double m = cloth_.mass[std::size_t(i)];
        r.segment<3>(3 * k) = m * (here - v_.row(i).transpose()) -
            h / 2 * (m * scene_.field_at(i) - cloth_.drag * here);
    }
    cloth_.each_spring([&](int from, int to, const Neighbour& kind) {
        const Vec3 w = place(u, to) - place(u, from);
        const Vec3 d = (x_.row(to) - x_.row(from)).transpose() + h / 2 * w;
        const double l = d.norm();
        if (l == 0) return;
        const Vec3 n = d / l;
        const double tension = cloth_.stiffness[kind.family] * (l - cloth_.rest_length(kind));
        const Vec3 force = h / 2 * (tension + cloth_.spring_damping[kind.family] * w.dot(n)) * n;
        const int i = unknown_[std::size_t(from)], j = unknown_[std::size_t(to)];
        if (i >= 0) r.segment<3>(3 * i) -= force;
        if (j >= 0) r.segment<3>(3 * j) += force;
    });
    each_contact(h, u, [&](int k, const PenaltyContact& contact, const Vec3& x, const Vec3& v) {
        r.segment<3>(3 * k) -= h / 2 * contact.force(x, v);
    });
    return r;
}

void ImplicitMidpoint::assemble(double h, const Vector& u, bool exact) {
    entries_.clear();
    for (int k = 0; k < 3 * unknowns_; ++k)
        entries_.emplace_back(k, k, mass_[k] + h / 2 * cloth_.drag);
    cloth_.each_spring([&](int from, int to, const Neighbour& kind) {
        const double stiffness = cloth_.stiffness[kind.family];
        const Vec3 d =
            (x_.row(to) - x_.row(from)).transpose() + h / 2 * (place(u, to) - place(u, from));
        const double l = d.norm();
        Eigen::Matrix3d block = Eigen::Matrix3d::Zero();
        if (l > 0) {
            const Vec3 n = d / l;
            double across = 1 - cloth_.rest_length(kind) / l;
            if (!exact) across = std::max(across, 0.0);
            const Eigen::Matrix3d along = n * n.transpose();
            block = (h / 2 * cloth_.spring_damping[kind.family] + h * h / 4 * stiffness) * along +
                h * h / 4 * stiffness * across * (Eigen::Matrix3d::Identity() - along);
        }
        const int i = unknown_[std::size_t(from)], j = unknown_[std::size_t(to)];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {
                if (i >= 0 && a >= b) entries_.emplace_back(3 * i + a, 3 * i + b, block(a, b));
                if (j >= 0 && a >= b) entries_.emplace_back(3 * j + a, 3 * j + b, block(a, b));
                if (i >= 0 && j >= 0)
                    entries_.emplace_back(3 * std::max(i, j) + a, 3 * std::min(i, j) + b,
                                          -block(a, b));
            }
    });
    each_contact(h, u, [&](int k, const PenaltyContact& contact, const Vec3& x, const Vec3& v) {
        PenaltyContact::Derivatives d = contact.derivatives(x, v);
        if (!exact) d = contact.definite(d);
        const Eigen::Matrix3d block = h / 2 * d.by_v + h * h / 4 * d.by_x;
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b <= a; ++b) entries_.emplace_back(3 * k + a, 3 * k + b, block(a, b));
    });
    matrix_.setFromTriplets(entries_.begin(), entries_.end());
}

bool ImplicitMidpoint::factorise(double h, const Vector& u) {
    for (const bool exact : {true, false}) {
        assemble(h, u, exact);
        if (!analysed_) solver_.analyzePattern(matrix_);
        analysed_ = true;
        solver_.factorize(matrix_);
        if (solver_.info() == Eigen::Success && solver_.vectorD().minCoeff() > 0) return true;
    }
    return false;
}

int ImplicitMidpoint::step(Points& x, Points& v, double t, double h) {
    x_ = x;
    v_ = v;
    // The place x + h/2 v of a driven pin is that of the middle of the step.
    scene_.each_driven_pin(StageTime::of_stage(t, h, 0.5), 0, cloth_.points(),
                           [&](int point, const Vec3& place, const Vec3& velocity) {
                               v_.row(point) = velocity;
                               x_.row(point) = place - h / 2 * velocity;
                           });
    contacts_.clear();
    for (const Sphere& sphere : scene_.spheres)
        if (sphere.penalty()) {
            contacts_.emplace_back(sphere, StageTime::of_stage(t, h, 0.5));
            contacts_.back().place += sphere.origin;  // states come relative to 0 here
        }
    int evaluations = 1;
    Vector u(3 * unknowns_);
    for (int i = 0; i < cloth_.points(); ++i)
        if (unknown_[std::size_t(i)] >= 0)
            u.segment<3>(3 * unknown_[std::size_t(i)]) = v_.row(i).transpose();
    const Vector start = u;
    Vector r = residual(h, u);
    double norm = size(r);
    for (int iteration = 0; iteration < most_iterations && norm > 0; ++iteration) {
        if (!factorise(h, u)) break;
        const Vector change = solver_.solve(r);
        double part = 1, best = norm;
        Vector next, next_r;
        for (int halving = 0; halving <= most_halvings; ++halving, part /= 2) {
            next = u - part * change;
            next_r = residual(h, next);
            ++evaluations;
            best = size(next_r);
            if (best < norm) break;
        }
        if (!(best < norm)) break;
        u = next;
        r = next_r;
        norm = best;
        // The parts of the residual: momentum, its change by the force, and h/2 K L of every
        // spring, whose rounding is in its tension K (l - L).
        const double parts = size((mass_.array() * u.array()).matrix()) +
            size((mass_.array() * (u - start).array()).matrix()) + h / 2 * tension_;
        if (norm <= converged * parts) break;
    }
    for (int i = 0; i < cloth_.points(); ++i) {
        if (unknown_[std::size_t(i)] < 0) continue;
        const Vec3 middle = u.segment<3>(3 * unknown_[std::size_t(i)]);
        x.row(i) += h * middle.transpose();
        v.row(i) = (2 * middle - v_.row(i).transpose()).transpose();
    }
    return evaluations;
}

}  // namespace clothsim
