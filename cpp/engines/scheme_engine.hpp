// The engine of every integrator but the fused RK4 of the kernels.
#pragma once

#include <memory>

#include "engines/engine.hpp"

namespace clothsim {

std::unique_ptr<Engine> make_scheme_engine(const Plan& plan);

}  // namespace clothsim
