// Wind: pressure and shear of moving air on the triangles of the mesh.
//
//     a-----b    triangles (a, b, d) and (b, e, d) of each cell, as pictures and exports have them
//     |   / |
//     | /   |    N   product of two sides: normal to the triangle, twice its area A long
//     d-----e    u   velocity of the air relative to the mean of the corners
//
//     un = u.N / |N|,  n = N / |N|,  ut = u - un n
//     F = density / 2 A (normal sqrt(un^2 + w^2) un n + tangential sqrt(ut.ut + w^2) ut)
//
// A third of F acts on each corner. The speed w makes the force smooth where the air rests. With
// q = u.N, and |N| taken into the roots, so that a triangle without area has no force,
//
//     F = density / 4 ((normal P - tangential S) q / N.N N + tangential S u)
//     P = sqrt(q^2 + w^2 N.N),  S = sqrt((u.u + w^2) N.N - q^2)
//
// Values: velocity (3) [m/s], density [kg/m^3], normal, tangential, and the largest speed of the
// motion [m/s].
#include <algorithm>
#include <array>
#include <cmath>
#include <Eigen/Geometry>

#include "lanes/versions.hpp"
#include "model/force.hpp"

namespace clothsim {
namespace {

constexpr double slow = 0.01;  // w [m/s]
constexpr double tiny = 1e-300;  // of N.N [m^4]
constexpr int components = 6;  // x, y, z, and those of the velocity

// The values of a row of mass points, or of a triangle of each of its cells: a plane for each
// component.
struct Planes {
    double* first;
    std::ptrdiff_t stride;
    double* plane(int k) const { return first + k * stride; }
};

struct Air {
    double velocity[3];
    double normal, tangential;  // times density / 4
};

inline __attribute__((always_inline)) void press(const double (&a)[6], const double (&b)[6],
                                                 const double (&c)[6], const Air& air,
                                                 double (&force)[3]) {
    const double r[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double s[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    const double n[3] = {r[1] * s[2] - r[2] * s[1], r[2] * s[0] - r[0] * s[2],
                         r[0] * s[1] - r[1] * s[0]};
    double u[3];
    for (int k = 0; k < 3; ++k)
        u[k] = air.velocity[k] - (a[3 + k] + b[3 + k] + c[3 + k]) * (1.0 / 3);
    const double n2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    const double q = u[0] * n[0] + u[1] * n[1] + u[2] * n[2];
    const double q2 = q * q;
    const double u2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
    const double across = (u2 + slow * slow) * n2 - q2;
    const double pressure = air.normal * std::sqrt(q2 + slow * slow * n2);
    const double shear = air.tangential * std::sqrt(across > 0 ? across : 0);
    const double along_n = (pressure - shear) * q / (n2 > tiny ? n2 : tiny);
    for (int k = 0; k < 3; ++k) force[k] = along_n * n[k] + shear * u[k];
}

// Computes the forces on both triangles of each cell between two rows.
CLOTHSIM_VERSIONS
void press_triangles_of_cells(const double* __restrict upper, const double* __restrict lower,
                              std::ptrdiff_t stride, int cells, const Air& of_row,
                              double* __restrict first, double* __restrict second) {
    const Air air = of_row;
    for (int i = 0; i < cells; ++i) {
        double a[6], b[6], d[6], e[6], f[3], g[3];
        for (int k = 0; k < components; ++k) {
            a[k] = upper[k * stride + i];
            b[k] = upper[k * stride + i + 1];
            d[k] = lower[k * stride + i];
            e[k] = lower[k * stride + i + 1];
        }
        press(a, b, d, air, f);
        press(b, e, d, air, g);
        for (int k = 0; k < 3; ++k) {
            first[k * stride + i] = f[k];
            second[k * stride + i] = g[k];
        }
    }
}

CLOTHSIM_VERSIONS
void take_apart(const double* __restrict x, const double* __restrict v, int count,
                std::ptrdiff_t stride, double* __restrict planes) {
    for (int i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) {
            planes[k * stride + i] = x[3 * i + k];
            planes[(3 + k) * stride + i] = v[3 * i + k];
        }
}

// Adds a third of the forces on the cells above or below to the points of a row. Before the first
// cell and after the last there are zeros.
CLOTHSIM_VERSIONS
void add_cells(const double* __restrict one, const double* __restrict two,
               const double* __restrict three, std::ptrdiff_t stride, int count,
               double* __restrict force) {
    for (int i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k)
            force[3 * i + k] +=
                (one[k * stride + i] + two[k * stride + i] + three[k * stride + i]) * (1.0 / 3);
}

class Wind final : public Force {
public:
    using Force::Force;

    void act(const Cloth& cloth, const ForceState& state, int begin, int end,
             double* force) const override {
        const int columns = cloth.columns;
        const Air air = air_at(state.time);
        const std::ptrdiff_t stride = columns + 2;
        std::vector<double> memory(std::size_t((2 * components + 6) * stride), 0.0);
        double* upper = memory.data();
        double* lower = upper + components * stride;
        double* const first = lower + components * stride + 1;
        double* const second = first + 3 * stride;
        const auto load = [&](int row, double* to) {
            const std::ptrdiff_t point = 3 * std::ptrdiff_t(row) * columns;
            take_apart(state.x + point, state.v + point, columns, stride, to);
        };
        const int above = std::max(begin - 1, 0);
        const int below = std::min(end, cloth.rows - 1);
        load(above, upper);
        for (int row = above; row < below; ++row) {
            load(row + 1, lower);
            press_triangles_of_cells(upper, lower, stride, columns - 1, air, first, second);
            double* const to = force + 3 * std::ptrdiff_t(row) * columns;
            if (row >= begin) add_cells(first, first - 1, second - 1, stride, columns, to);
            if (row + 1 < end)
                add_cells(first, second, second - 1, stride, columns, to + 3 * columns);
            std::swap(upper, lower);
        }
    }

    // The derivative by u of a triangle's force is at most twice density / 2 A max(normal,
    // tangential) sqrt(u.u + w^2), and the square of the mean velocity at most the mean of squares:
    // a point with six triangles has a third of each. So it is that of two triangles.
    double damping_bound(const Cloth& cloth, double speed) const override {
        speed += Vec3(values.data()).norm() + values[6];
        return values[3] * cloth.row_spacing * cloth.column_spacing *
            std::max(values[4], values[5]) * std::hypot(speed, slow) * cloth.largest_mobility();
    }

    void each_damping(const Cloth& cloth, const ForceState& state,
                      const AddDerivative& add) const override {
        const Air air = air_at(state.time);
        const auto point = [&](const double* of, int i) {
            return Vec3(of + 3 * std::ptrdiff_t(i));
        };
        const auto triangle = [&](const std::array<int, 3>& corners) {
            const auto& [a, b, c] = corners;
            const Vec3 side = point(state.x, b) - point(state.x, a);
            const Vec3 N = side.cross(Vec3(point(state.x, c) - point(state.x, a)));
            const Vec3 mean =
                (point(state.v, a) + point(state.v, b) + point(state.v, c)) * (1.0 / 3);
            if (N.norm() == 0) return;
            const Vec3 u = Vec3(air.velocity) - mean;
            const Vec3 n = N.normalized();
            const double un = u.dot(n);
            const Vec3 ut = u - un * n;
            const double pressed = std::hypot(un, slow);
            const double sheared = std::hypot(ut.norm(), slow);
            const Eigen::Matrix3d along = n * n.transpose();
            const Eigen::Matrix3d derivative = N.norm() / 9 *
                (air.normal * (pressed + un * un / pressed) * along +
                 air.tangential *
                     (sheared * (Eigen::Matrix3d::Identity() - along) +
                      ut * ut.transpose() / sheared));
            for (const int i : corners)
                for (const int j : corners) add(i, j, derivative);
        };
        for (int row = 0; row + 1 < cloth.rows; ++row)
            for (int column = 0; column + 1 < cloth.columns; ++column) {
                const int i = row * cloth.columns + column;
                triangle({i, i + 1, i + cloth.columns});
                triangle({i + 1, i + cloth.columns + 1, i + cloth.columns});
            }
    }

private:
    Air air_at(const StageTime& time) const {
        Air air{};
        const Vec3 gust = motion.at(time.t, time.inside).velocity;
        for (int k = 0; k < 3; ++k) air.velocity[k] = values[std::size_t(k)] + gust[k];
        air.normal = values[3] / 4 * values[4];
        air.tangential = values[3] / 4 * values[5];
        return air;
    }
};

}  // namespace

std::shared_ptr<const Force> make_wind(std::string name, std::vector<double> values,
                                       Motion motion) {
    return std::make_shared<Wind>(std::move(name), std::move(values), std::move(motion));
}

}  // namespace clothsim
