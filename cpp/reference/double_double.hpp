// A number as the sum of two doubles, 106 bits of it (Dekker, Numerische Mathematik 18 (1971) 224).
#pragma once

#include <cmath>

namespace clothsim::reference {

struct DoubleDouble {
    double high = 0;
    double low = 0;  // |low| is at most half a unit in the last place of high

    DoubleDouble(double value = 0, double rest = 0)
        : high(value + rest), low(rest - (high - value)) {}
    explicit operator double() const { return high; }
    DoubleDouble operator-() const { return {-high, -low}; }
};

inline DoubleDouble operator+(const DoubleDouble& a, const DoubleDouble& b) {
    const double sum = a.high + b.high;
    const double part = sum - a.high;
    return {sum, (a.high - (sum - part)) + (b.high - part) + (a.low + b.low)};
}
inline DoubleDouble operator-(const DoubleDouble& a, const DoubleDouble& b) { return a + -b; }
inline DoubleDouble operator*(const DoubleDouble& a, const DoubleDouble& b) {
    // Returns the upper 26 bits of 53.
    const auto upper = [](double x) { return 134217729 * x - (134217729 * x - x); };
    const double product = a.high * b.high;
    const double p = upper(a.high);
    const double q = upper(b.high);
    const double rest =
        p * q - product + p * (b.high - q) + (a.high - p) * q + (a.high - p) * (b.high - q);
    return {product, rest + (a.high * b.low + a.low * b.high)};
}
inline DoubleDouble operator/(const DoubleDouble& a, const DoubleDouble& b) {
    const double quotient = a.high / b.high;
    return {quotient, (a - b * quotient).high / b.high};
}
inline DoubleDouble& operator+=(DoubleDouble& a, const DoubleDouble& b) { return a = a + b; }
inline DoubleDouble& operator-=(DoubleDouble& a, const DoubleDouble& b) { return a = a - b; }

inline DoubleDouble sqrt(const DoubleDouble& a) {
    const double root = std::sqrt(a.high);
    if (root == 0) return 0;
    return {root, (a - DoubleDouble(root) * root).high / (2 * root)};
}

// Taylor's series within 1/16; beyond, of half the argument.
inline DoubleDouble expm1(const DoubleDouble& x) {
    if (std::abs(x.high) > 0.0625) {
        const DoubleDouble half = expm1(x / 2);
        return half * (half + 2);
    }
    DoubleDouble sum = 0;
    for (int n = 18; n > 0; --n) sum = x / n * (sum + 1);
    return sum;
}
inline DoubleDouble exp(const DoubleDouble& x) { return expm1(x) + 1; }

struct SineCosine {
    DoubleDouble sine, versine;  // versine: 1 - cosine
};
inline SineCosine sine_cosine(const DoubleDouble& x) {
    if (std::abs(x.high) > 0.0625) {
        const auto [s, c] = sine_cosine(x / 2);
        return {2 * s * (1 - c), 2 * s * s};
    }
    DoubleDouble sine = 0, versine = 0;
    for (int n = 9; n > 0; --n) {
        sine = x * x / (2 * n * (2 * n + 1)) * (1 - sine);
        versine = x * x / (2 * n * (2 * n - 1)) * (1 - versine);
    }
    return {x * (1 - sine), versine};
}
inline DoubleDouble sin(const DoubleDouble& x) { return sine_cosine(x).sine; }
inline DoubleDouble cos(const DoubleDouble& x) { return 1 - sine_cosine(x).versine; }

}  // namespace clothsim::reference
