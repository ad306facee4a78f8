#include "lanes/dot.hpp"

#include "lanes/versions.hpp"

namespace clothsim {
namespace {

CLOTHSIM_VERSIONS
double sum_products(const double* __restrict a, const double* __restrict b, int count) {
    constexpr int parts = 8;
    double sums[parts] = {};
    int i = 0;
    for (; i + parts <= count; i += parts)
        for (int k = 0; k < parts; ++k) sums[k] += a[i + k] * b[i + k];
    for (int k = 0; i < count; ++i, ++k) sums[k] += a[i] * b[i];
    double sum = 0;
    for (const double part : sums) sum += part;
    return sum;
}

}  // namespace

double dot(const double* a, const double* b, int count) { return sum_products(a, b, count); }

}  // namespace clothsim
