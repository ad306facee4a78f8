// Layout of states and accelerations of an engine, as far as the integrators need it. A row is `runs` runs of
// `length` elements of x, each with its run of v and of the acceleration. Padding is part of a run. Its
// velocity and acceleration are 0, so it stays in place.
#pragma once

#include <cstddef>

namespace clothsim {

struct FieldLayout {
    int runs, length;
    // Elements of a state array: from the start to row 0, from row to row, from run to run, from x to v. The
    // last is from a value to its compensation (0: not compensated).
    std::ptrdiff_t origin, row, run, velocity, compensation;
    // The same of accelerations. Several of them lie in one block, a slot each.
    std::ptrdiff_t acceleration_origin, acceleration_row, acceleration_run;
    int slots;
    std::ptrdiff_t slot, block;

    std::ptrdiff_t acceleration_size(int count) const { return (count + slots - 1) / slots * block; }
    std::ptrdiff_t acceleration(int index) const { return index / slots * block + index % slots * slot; }
};

}  // namespace clothsim
