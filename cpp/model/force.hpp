// A force on the mass points of a cloth beside springs, gravity and contact, as a kind of thing.
// The forces that there are: cpp/forces/table.cpp. To add one: docs/howto/add-a-force.md.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "model/cloth.hpp"
#include "model/motion.hpp"

namespace clothsim {

// The state of a whole cloth at a time, in arrays of shape (points, 3).
struct ForceState {
    StageTime time;
    const double* x;  // m, relative to the origin of space
    const double* v;  // m/s
};

class Force {
public:
    Force(std::string name, std::vector<double> values, Motion motion)
        : name(std::move(name)), values(std::move(values)), motion(std::move(motion)) {}
    virtual ~Force() = default;

    // Write the force on the mass points of rows [begin, end) [N] into an array of shape
    // (points, 3), whose rows are 0. Rows have the same bits however they are dealt to threads.
    virtual void act(const Cloth& cloth, const ForceState& state, int begin, int end,
                     double* force) const = 0;
    // Return whether one call must serve all rows.
    virtual bool whole() const { return false; }
    // Return whether the kernels compute it; the engines call the others before they sum the
    // springs.
    virtual bool in_kernels() const { return false; }

    // Return a bound of the damping rates [1/s] that it gives to modes of a cloth whose fastest
    // point has this speed [m/s].
    virtual double damping_bound(const Cloth&, double /*speed*/) const { return 0; }
    // Call `add(i, j, derivative)` with minus the symmetric derivative of the force on mass point i
    // by the velocity of j [N s/m].
    using AddDerivative = std::function<void(int i, int j, const Eigen::Matrix3d& derivative)>;
    virtual void each_damping(const Cloth&, const ForceState&, const AddDerivative&) const {}

    // What it is made of, also for the oracle, which has a code of its own for each name.
    const std::string name;
    const std::vector<double> values;
    const Motion motion;
};

}  // namespace clothsim
