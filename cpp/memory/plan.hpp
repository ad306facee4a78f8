// A scene compiled for the core: what has to be computed, in which precision, by which kernels.
#pragma once

#include <string>

#include "kernels/kernel_table.hpp"
#include "model/scene.hpp"

namespace clothsim {

enum class Precision {
    single,
    double_,
};
enum class Kernel {
    gather,
    edge,
};

struct Plan : Scene {
    Precision precision = Precision::double_;
    Kernel kernel = Kernel::edge;
    std::string integrator = "rk4";
    const KernelTable* kernels = nullptr;

    Features features() const { return {cloth.present, cloth.has_spring_damping()}; }
};

}  // namespace clothsim
