#include "integrators/implicit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

namespace clothsim {
namespace {

// Beyond these bounds, which are not tuned, a step counts as failed.
constexpr int most_iterations = 60;
constexpr int most_halvings = 12;
// Residual relative to its parts, which Newton's method reaches a few times above rounding.
constexpr double least_residual = 1e-14;
// The most that is taken for a solution where the derivatives of a force are unknown.
constexpr double most_residual = 1e-9;

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
    forces_.assign(scene.forces.size(), Points::Zero(cloth.points(), 3));
    work_.assign(scene.forces.size(), 0.0);
    stage_x_.resize(cloth.points(), 3);
    stage_v_.resize(cloth.points(), 3);
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

bool ImplicitMidpoint::has_function() const {
    return std::any_of(scene_.forces.begin(), scene_.forces.end(),
                       [](const auto& force) { return force->whole(); });
}

ForceState ImplicitMidpoint::stage(double h, const Vector& u) {
    for (int i = 0; i < cloth_.points(); ++i) {
        const Vec3 velocity = place(u, i);
        stage_x_.row(i) = x_.row(i) + h / 2 * velocity.transpose();
        stage_v_.row(i) = velocity;
    }
    return {middle_, stage_x_.data(), stage_v_.data()};
}

void ImplicitMidpoint::act(double h, const Vector& u) {
    if (forces_.empty()) return;
    const ForceState state = stage(h, u);
    for (std::size_t k = 0; k < forces_.size(); ++k) {
        forces_[k].setZero();
        scene_.forces[k]->act(cloth_, state, 0, cloth_.rows, forces_[k].data());
    }
}

// Returns M (u - v) - h/2 F(x + h/2 u, u).
auto ImplicitMidpoint::residual(double h, const Vector& u) -> Vector {
    act(h, u);
    Vector r(3 * unknowns_);
    for (int i = 0; i < cloth_.points(); ++i) {
        const int k = unknown_[std::size_t(i)];
        if (k < 0) continue;
        const Vec3 velocity = u.segment<3>(3 * k);
        const double m = cloth_.mass[std::size_t(i)];
        Vec3 force = m * scene_.field_at(i);
        for (const Points& of_points : forces_) force += of_points.row(i).transpose();
        r.segment<3>(3 * k) = m * (velocity - v_.row(i).transpose()) - h / 2 * force;
    }
    cloth_.each_spring([&](int from, int to, const Neighbour& kind) {
        const Vec3 w = place(u, to) - place(u, from);
        const Vec3 d = (x_.row(to) - x_.row(from)).transpose() + h / 2 * w;
        const double l = d.norm();
        if (l == 0) return;
        const Vec3 n = d / l;
        const double tension = cloth_.stiffness[kind.family] * (l - cloth_.rest_length(kind));
        const Vec3 force = h / 2 * (tension + cloth_.spring_damping[kind.family] * w.dot(n)) * n;
        const int i = unknown_[std::size_t(from)];
        const int j = unknown_[std::size_t(to)];
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
    for (int k = 0; k < 3 * unknowns_; ++k) entries_.emplace_back(k, k, mass_[k]);
    const ForceState state = stage(h, u);
    for (const auto& force : scene_.forces)
        force->each_damping(
            cloth_, state, [&](int from, int to, const Eigen::Matrix3d& derivative) {
                const int i = unknown_[std::size_t(from)];
                const int j = unknown_[std::size_t(to)];
                if (i < j || j < 0) return;
                for (int a = 0; a < 3; ++a)
                    for (int b = 0; b < (i == j ? a + 1 : 3); ++b)
                        entries_.emplace_back(3 * i + a, 3 * j + b, h / 2 * derivative(a, b));
            });
    cloth_.each_spring([&](int from, int to, const Neighbour& kind) {
        const double stiffness = cloth_.stiffness[kind.family];
        const Vec3 d =
            (x_.row(to) - x_.row(from)).transpose() + h / 2 * (place(u, to) - place(u, from));
        const double l = d.norm();
        Eigen::Matrix3d derivative = Eigen::Matrix3d::Zero();
        if (l > 0) {
            const Vec3 n = d / l;
            double across = 1 - cloth_.rest_length(kind) / l;
            if (!exact) across = std::max(across, 0.0);
            const Eigen::Matrix3d along = n * n.transpose();
            derivative =
                (h / 2 * cloth_.spring_damping[kind.family] + h * h / 4 * stiffness) * along +
                h * h / 4 * stiffness * across * (Eigen::Matrix3d::Identity() - along);
        }
        const int i = unknown_[std::size_t(from)];
        const int j = unknown_[std::size_t(to)];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {
                if (i >= 0 && a >= b) entries_.emplace_back(3 * i + a, 3 * i + b, derivative(a, b));
                if (j >= 0 && a >= b) entries_.emplace_back(3 * j + a, 3 * j + b, derivative(a, b));
                if (i >= 0 && j >= 0)
                    entries_.emplace_back(3 * std::max(i, j) + a, 3 * std::min(i, j) + b,
                                          -derivative(a, b));
            }
    });
    each_contact(h, u, [&](int k, const PenaltyContact& contact, const Vec3& x, const Vec3& v) {
        PenaltyContact::Derivatives d = contact.derivatives(x, v);
        if (!exact) d = contact.positive_definite(d);
        const Eigen::Matrix3d derivative = h / 2 * d.by_v + h * h / 4 * d.by_x;
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b <= a; ++b)
                entries_.emplace_back(3 * k + a, 3 * k + b, derivative(a, b));
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

int ImplicitMidpoint::step(Points& x, Points& v, double t, double h, std::exception_ptr& failure) {
    if (!failure) try {
            return solve(x, v, t, h);
        } catch (...) {
            failure = std::current_exception();
        }
    x.setConstant(std::numeric_limits<double>::quiet_NaN());
    return 0;
}

int ImplicitMidpoint::solve(Points& x, Points& v, double t, double h) {
    x_ = x;
    v_ = v;
    middle_ = StageTime::of_stage(t, h, 0.5);
    // The place x + h/2 v of a driven pin is that of the middle of the step.
    scene_.each_driven_pin(middle_, 0, cloth_.points(),
                           [&](int point, const Vec3& place, const Vec3& velocity) {
                               v_.row(point) = velocity;
                               x_.row(point) = place - h / 2 * velocity;
                           });
    contacts_.clear();
    for (const Sphere& sphere : scene_.spheres)
        if (sphere.penalty()) contacts_.emplace_back(sphere, middle_);
    int evaluations = 1;
    Vector u(3 * unknowns_);
    for (int i = 0; i < cloth_.points(); ++i)
        if (unknown_[std::size_t(i)] >= 0)
            u.segment<3>(3 * unknown_[std::size_t(i)]) = v_.row(i).transpose();
    const Vector start = u;
    Vector r = residual(h, u);
    double norm = size(r);
    double parts = norm;
    for (int iteration = 0; iteration < most_iterations && norm > 0; ++iteration) {
        if (!factorise(h, u)) break;
        const Vector change = solver_.solve(r);
        double part = 1;
        double best = norm;
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
        parts = size((mass_.array() * u.array()).matrix()) +
            size((mass_.array() * (u - start).array()).matrix()) + h / 2 * tension_;
        if (norm <= least_residual * parts) break;
    }
    if (!(norm <= most_residual * parts) && has_function()) {
        std::ostringstream text;
        text << "integrator 'implicit_midpoint' does not converge at t = " << t
             << " s: it has no derivative of `force`; take a smaller dt, or another integrator";
        throw std::domain_error(text.str());
    }
    act(h, u);
    for (std::size_t k = 0; k < forces_.size(); ++k) {
        work_[k] = 0;
        for (int i = 0; i < cloth_.points(); ++i)
            if (unknown_[std::size_t(i)] >= 0)
                work_[k] += h * forces_[k].row(i).dot(stage_v_.row(i));
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
