#include "dynamics/scheme_engine.hpp"
#include "simulation/edge_engine.hpp"
#include "simulation/gather_engine.hpp"
#include "simulation/stability.hpp"

namespace clothsim {
namespace {

template <class Real>
std::unique_ptr<Engine> make(const Plan& plan) {
    const bool gather = plan.kernel == Kernel::gather;
    if (method_of(plan.integrator).scheme != Scheme::rk4) {
        if (gather) return std::make_unique<SchemeEngine<Real, GatherEngine<Real>>>(plan);
        return std::make_unique<SchemeEngine<Real, EdgeEngine<Real>>>(plan);
    }
    if (gather) return std::make_unique<GatherEngine<Real>>(plan);
    return std::make_unique<EdgeEngine<Real>>(plan);
}

}  // namespace

double runaway_speed(const Cloth& cloth, double dt) {
    if (dt <= rk4_stable_dt(cloth)) return std::numeric_limits<double>::infinity();
    return std::hypot((cloth.rows - 1) * cloth.row_spacing, (cloth.columns - 1) * cloth.column_spacing) / dt;
}

std::unique_ptr<Engine> make_engine(const Plan& plan) {
    return plan.precision == Precision::single ? make<float>(plan) : make<double>(plan);
}

}  // namespace clothsim
