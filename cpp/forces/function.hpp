// The force of a user's function of time, positions and velocities.
#pragma once

#include <cmath>
#include <cstdint>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "lanes/dot.hpp"
#include "model/force.hpp"

namespace clothsim {

class FunctionForce final : public Force {
public:
    // Writes the force on every mass point [N] into `f`, which is 0; arrays have the shape
    // (points, 3).
    using Function = std::function<void(double t, const double* x, const double* v, double* f,
                                        std::int64_t points)>;
    FunctionForce(Function function, bool forces_need_caller)
        : Force("function", {}, {}),
          forces_need_caller(forces_need_caller),
          function_(std::move(function)) {}

    void act(const Cloth& cloth, const ForceState& state, int, int, double* force) const override {
        function_(state.time.t, state.x, state.v, force, cloth.points());
        const int size = 3 * cloth.points();
        const double sum = dot(force, force, size);
        for (int k = 0; k < size && !std::isfinite(sum); ++k)
            if (!std::isfinite(force[k])) refuse(cloth, k / 3, force[k], state.time.t);
    }
    bool whole() const override { return true; }

    // Whether only the thread that calls the core may call the function.
    const bool forces_need_caller;

private:
    [[noreturn]] static void refuse(const Cloth& cloth, int point, double value, double t) {
        std::ostringstream text;
        text << "force must write finite numbers [N], got " << value << " at the mass point ("
             << point / cloth.columns << ", " << point % cloth.columns << ") at t = " << t << " s";
        throw std::domain_error(text.str());
    }
    Function function_;
};

}  // namespace clothsim
