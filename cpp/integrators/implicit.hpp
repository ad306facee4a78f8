// The implicit midpoint rule, for steps far above every explicit stability limit:
//
//   u = v + h/2 a(x + h/2 u, u)        x' = x + h u        v' = 2 u - v
//
// u is found by Newton's method on R(u) = M (u - v) - h/2 F = 0 with the sparse symmetric matrix
//
//   J = M + h/2 D + h^2/4 K,    K, D: minus the derivatives of the force by x and by v
//
// The springs' exact K is taken while J is positive definite. It may not be, with compressed
// springs at a huge step. Then the part of a compressed spring across its direction is left out
// (Baraff and Witkin, Large steps in cloth simulation, SIGGRAPH 98). The residual decides, so
// either way the solution belongs to the rule itself. The step is halved wherever the residual
// would grow, so it converges from far.
#pragma once

#include <Eigen/Sparse>
#include <exception>

#include "forces/penalty.hpp"
#include "model/scene.hpp"

namespace clothsim {

class ImplicitMidpoint {
public:
    // Forces on points may change between steps, and are read from `scene`.
    explicit ImplicitMidpoint(const Scene& scene);

    // Takes a step in place from time t; driven pins stay as they are. Returns the number of force
    // evaluations (a factorisation each, but for those of halved steps). The state is NaN where a
    // force has thrown, now or before, and where the iteration does not converge.
    int step(Points& x, Points& v, double t, double h, std::exception_ptr& failure);
    // Returns the work of the scene's force of this number in the last step [J].
    double work(std::size_t force) const { return work_[force]; }

private:
    using Vector = Eigen::VectorXd;
    using Matrix = Eigen::SparseMatrix<double>;

    int solve(Points& x, Points& v, double t, double h);
    Vector residual(double h, const Vector& u);
    // The state at the stage, and the forces of the scene there.
    ForceState stage(double h, const Vector& u);
    void act(double h, const Vector& u);
    // Returns whether a force is a user's, of which no derivative is known.
    bool has_function() const;
    void assemble(double h, const Vector& u, bool exact);
    bool factorise(double h, const Vector& u);
    Vec3 place(const Vector& values, int point) const;
    double size(const Vector& momenta) const;  // norm weighted by 1 / mass

    // Calls `visit(unknown, contact, place, velocity)` for each free mass point and obstacle at the
    // stage.
    template <class Visit>
    void each_contact(double h, const Vector& u, Visit visit) const;

    const Scene& scene_;
    const Cloth& cloth_;
    std::vector<int> unknown_;  // the unknown of each point, -1: pinned
    int unknowns_ = 0;
    Vector mass_;  // per unknown
    double tension_ = 0;  // size of K L, summed over the springs of each point
    Points x_, v_;  // at the start of the step
    std::vector<PenaltyContact> contacts_;  // at its middle
    StageTime middle_{};
    Points stage_x_, stage_v_;
    std::vector<Points> forces_;  // on the mass points at the stage [N]
    std::vector<double> work_;
    Matrix matrix_;
    std::vector<Eigen::Triplet<double>> entries_;
    Eigen::SimplicialLDLT<Matrix> solver_;
    bool analysed_ = false;
};

}  // namespace clothsim
