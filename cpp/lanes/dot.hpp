// Sums of products that are the same for every instruction set.
#pragma once

namespace clothsim {

double dot(const double* a, const double* b, int count);

}  // namespace clothsim
