// The reference's own list of springs, which the model's (model/stencil.hpp) is checked against.
#pragma once

#include <vector>

#include "model/cloth.hpp"

namespace clothsim::reference {

struct Spring {
    int i, j;
    double rest_length, stiffness, damping;
};

std::vector<Spring> springs(const Cloth& cloth);

}  // namespace clothsim::reference
