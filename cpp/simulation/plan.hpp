// A scene compiled for the core: what has to be computed, in which precision, by which kernels.
#pragma once

#include <string>
#include <vector>

#include "kernels/dispatch.hpp"
#include "model/cloth.hpp"
#include "model/sphere.hpp"

namespace clothsim {

enum class Precision { single, double_ };
enum class Kernel { gather, edge };

struct Plan {
    Cloth cloth;
    Vec3 gravity = Vec3::Zero();
    std::vector<Sphere> spheres;
    Precision precision = Precision::double_;
    Kernel kernel = Kernel::edge;
    bool strict = false;  // gather only
    std::string integrator = "rk4";
    const KernelTable* kernels = nullptr;

    Features features() const {
        return {cloth.present[structural], cloth.present[shear], cloth.present[bend], cloth.has_spring_damping()};
    }
};

}  // namespace clothsim
