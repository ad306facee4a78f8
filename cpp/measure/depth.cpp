#include "measure/depth.hpp"

#include <limits>

#include "memory/versions.hpp"

namespace clothsim {
namespace {

template <class Real, int lanes>
inline __attribute__((always_inline)) double least(const Real* row, const VectorGeometry& g,
                                                   const double* center) {
    double squares[lanes];
    for (int l = 0; l < lanes; ++l) squares[l] = std::numeric_limits<double>::infinity();
    for (int j = 0; j < g.vectors; ++j) {
        const Real* const x = row + j * g.vector;
        const Real* const y = x + g.component;
        const Real* const z = y + g.component;
        for (int l = 0; l < lanes; ++l) {
            double dx = x[l], dy = y[l], dz = z[l];
            if constexpr (sizeof(Real) == 4) {
                dx += double(x[l + g.compensation]);
                dy += double(y[l + g.compensation]);
                dz += double(z[l + g.compensation]);
            }
            dx -= center[0];
            dy -= center[1];
            dz -= center[2];
            const double square = dx * dx + (dy * dy + dz * dz);
            squares[l] = square < squares[l] ? square : squares[l];
        }
    }
    double result = squares[0];
    for (int l = 1; l < lanes; ++l) result = squares[l] < result ? squares[l] : result;
    return result;
}

template <class Real>
inline __attribute__((always_inline)) double least_of(const Real* row, const VectorGeometry& g, int lanes,
                                                      const double* center) {
    switch (lanes) {
        case 16: return least<Real, 16>(row, g, center);
        case 8: return least<Real, 8>(row, g, center);
        case 4: return least<Real, 4>(row, g, center);
        default: return least<Real, 2>(row, g, center);
    }
}

CLOTHSIM_VERSIONS double versions(const float* row, const VectorGeometry& g, int lanes,
                                  const double* center) {
    return least_of(row, g, lanes, center);
}
CLOTHSIM_VERSIONS double versions(const double* row, const VectorGeometry& g, int lanes,
                                  const double* center) {
    return least_of(row, g, lanes, center);
}

}  // namespace

template <class Real>
double least_square(const Real* row, const VectorGeometry& geometry, int lanes, const Vec3& center) {
    return versions(row, geometry, lanes, center.data());
}
template double least_square(const float*, const VectorGeometry&, int, const Vec3&);
template double least_square(const double*, const VectorGeometry&, int, const Vec3&);

}  // namespace clothsim
