// The forces by their names.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "model/force.hpp"

namespace clothsim {

// Throws std::invalid_argument for a name that is none.
std::shared_ptr<const Force> make_force(const std::string& name, std::vector<double> values,
                                        Motion motion);

}  // namespace clothsim
