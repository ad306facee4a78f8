// A simulation between steps as named fields, each a number or an array.
#pragma once

#include "bindings/bindings.hpp"
#include "driver/simulation.hpp"

namespace clothsim {

// Positions, velocities, their low parts (in single) and origins: one entry for each member. The sums
// of impulses: one entry for each sphere of each member. The clock: time, and what it is counted from.
py::dict saved_fields(Simulation& simulation);

// Continue from fields. Throws std::invalid_argument, and changes nothing, where they are of another shape,
// precision or batch.
void restore_fields(Simulation& simulation, const py::dict& fields);

}  // namespace clothsim
