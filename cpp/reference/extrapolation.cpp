// A second opinion on a solution: another method, another arithmetic, another evaluation of the
// forces.
//
// Gragg's modified midpoint rule with 2, 4, ..., 2k substeps, extrapolated to substep 0 by Aitken
// and Neville. (Gragg-Bulirsch-Stoer; Hairer, Norsett, Wanner, Solving Ordinary Differential
// Equations I, section II.9.) The order is 2k for k columns. The step follows the difference of the
// last two columns. Everything is computed in sums of two doubles, 106 bits, from the reference's
// own list of springs. So an error in the kernels or in the model's list, and rounding in double,
// both show as a difference.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "memory/threads.hpp"
#include "reference/contact.hpp"
#include "reference/double_double.hpp"
#include "reference/forces.hpp"
#include "reference/pins.hpp"
#include "reference/reference.hpp"

namespace clothsim::reference {
namespace {

using Real = DoubleDouble;
using Values = std::vector<Real>;  // 3 a point

struct State {
    Values x, v;
    explicit State(std::size_t size) : x(size), v(size) {}
};

// A scene with its springs.
struct System {
    const Scene& scene;
    std::vector<Spring> springs;
};

void accelerations(const System& system, const State& state, const Real& t, double time_inside,
                   Values& a) {
    const Values& x = state.x;
    const Values& v = state.v;
    const Cloth& cloth = system.scene.cloth;
    for (std::size_t k = 0; k < a.size(); ++k)
        a[k] = system.scene.has_force() ? system.scene.force.data()[k] : 0;
    add_forces(system.scene, x.data(), v.data(), t, time_inside, a.data());
    for (const Spring& s : system.springs) {
        const Real *xi = &x[3 * s.i], *xj = &x[3 * s.j], *vi = &v[3 * s.i], *vj = &v[3 * s.j];
        const Real d[3] = {xj[0] - xi[0], xj[1] - xi[1], xj[2] - xi[2]};
        const Real length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        if (double(length) == 0) continue;  // no direction, no force
        const Real inverse = 1 / length;
        const Real rate =
            ((vj[0] - vi[0]) * d[0] + (vj[1] - vi[1]) * d[1] + (vj[2] - vi[2]) * d[2]) * inverse;
        const Real pull = (s.stiffness * (length - s.rest_length) + s.damping * rate) * inverse;
        for (int c = 0; c < 3; ++c) {
            a[3 * s.i + c] += pull * d[c];
            a[3 * s.j + c] -= pull * d[c];
        }
    }
    for (const Sphere& sphere : system.scene.spheres) {
        if (!sphere.penalty()) continue;
        const PinState<Real> obstacle = motion_state(sphere.motion, sphere.center, t, time_inside);
        for (std::size_t k = 0; k < a.size(); k += 3)
            add_contact(sphere, obstacle, &x[k], &v[k], &a[k]);
    }
    for (std::size_t k = 0; k < a.size(); ++k)
        a[k] = cloth.pinned[k / 3] ? 0 : a[k] / cloth.mass[k / 3] + system.scene.gravity[k % 3];
}

void place_pins_of_state(const System& system, State& state, const Real& t, double time_inside) {
    place_pins(system.scene.driven_pins, system.scene.pin_motions, t, time_inside, state.x,
               state.v);
}

// Sets z = y + h (dx/dt, dv/dt).
void move(State& z, const State& y, const Values& velocity, const Values& a, const Real& h) {
    for (std::size_t k = 0; k < a.size(); ++k) {
        z.x[k] = y.x[k] + h * velocity[k];
        z.v[k] = y.v[k] + h * a[k];
    }
}

// Room for one column: three consecutive states of the midpoint rule.
struct Workspace {
    State previous, here, after;
    Values a;
    explicit Workspace(std::size_t size) : previous(size), here(size), after(size), a(size) {}
};

// Takes the modified midpoint rule with n (even) substeps over H: its error has an expansion in
// (H/n)^2. Gragg's smoothing at the end damps the rule's weak instability.
void midpoint(const System& system, const State& y, const Values& a0, const Real& t, const Real& H,
              int n, Workspace& w, State& result) {
    const Real h = H / n;
    const double time_inside(t + H / 2);
    w.previous = y;
    move(w.here, y, y.v, a0, h);
    place_pins_of_state(system, w.here, t + h, time_inside);
    for (int i = 1; i < n; ++i) {
        accelerations(system, w.here, t + i * h, time_inside, w.a);
        move(w.after, w.previous, w.here.v, w.a, 2 * h);
        place_pins_of_state(system, w.after, t + (i + 1) * h, time_inside);
        std::swap(w.previous, w.here);
        std::swap(w.here, w.after);
    }
    accelerations(system, w.here, t + H, time_inside, w.a);
    move(result, w.previous, w.here.v, w.a, h);
    for (std::size_t k = 0; k < result.x.size(); ++k) {
        result.x[k] = (result.x[k] + w.here.x[k]) / 2;
        result.v[k] = (result.v[k] + w.here.v[k]) / 2;
    }
    place_pins_of_state(system, result, t + H, time_inside);
}

// table[k] holds T(k, k - j) after sweep j of Aitken and Neville for substeps 2, 4, 6, ... The last
// entry becomes the result. It is compared with the entry before it in its row.
void neville(std::vector<State>& table, State& previous) {
    const int columns = int(table.size());
    for (int j = 1; j < columns; ++j) {
        if (j == columns - 1) previous = table[columns - 1];
        for (int k = columns - 1; k >= j; --k) {
            const Real ratio = Real(k + 1) / (k + 1 - j);
            const Real weight = 1 / (ratio * ratio - 1);
            for (std::size_t i = 0; i < previous.x.size(); ++i) {
                table[k].x[i] += weight * (table[k].x[i] - table[k - 1].x[i]);
                table[k].v[i] += weight * (table[k].v[i] - table[k - 1].v[i]);
            }
        }
    }
}

double extent(const Values& x) {
    double largest = 0;
    for (int c = 0; c < 3; ++c) {
        double low(x[c]);
        double high(x[c]);
        for (std::size_t k = c; k < x.size(); k += 3) {
            low = std::min(low, x[k].high);
            high = std::max(high, x[k].high);
        }
        largest = std::max(largest, high - low);
    }
    return largest > 0 ? largest : 1;
}

double difference(const State& a, const State& b, double H) {
    double largest = 0;
    for (std::size_t k = 0; k < a.x.size(); ++k) {
        const double error =
            std::max(std::abs(double(a.x[k] - b.x[k])), H * std::abs(double(a.v[k] - b.v[k])));
        if (!std::isfinite(error)) return std::numeric_limits<double>::infinity();
        largest = std::max(largest, error);
    }
    return largest;
}

}  // namespace

Extrapolation extrapolate(const Scene& scene, const std::vector<double>& times,
                          const ExtrapolationSettings& settings, std::vector<double>& x,
                          std::vector<double>& v, const std::function<bool()>& interrupted) {
    const System system{scene, springs(scene.cloth)};
    const int columns = settings.columns;
    const std::size_t size = x.size();
    State y(size), previous(size);
    for (std::size_t k = 0; k < size; ++k) {
        y.x[k] = x[k];
        y.v[k] = scene.cloth.pinned[k / 3] ? 0 : v[k];
    }
    std::vector<State> table(columns, State(size));
    std::vector<Workspace> room(columns, Workspace(size));
    Values a0(size);

    Extrapolation result;
    const double smallest = 1e-9 * times.back();
    Real t = 0;
    double H = times.back() / 64;
    for (const double target : times) {
        while (double(target - t) > 0) {
            result.interrupted = interrupted();
            if (result.interrupted) return result;
            // The remaining way is taken in equal parts, so that no sliver is left for the end.
            const Real step = (target - t) / std::ceil(double(target - t) / H);
            place_pins_of_state(system, y, t, double(t + step / 2));
            accelerations(system, y, t, double(t + step / 2), a0);
            // The longest come first: what is left at the end is short.
            std::atomic<int> next{columns};
            run_in_team(settings.threads, [&](int, int) {
                for (int k; (k = --next) >= 0;)
                    midpoint(system, y, a0, t, step, 2 * (k + 1), room[k], table[k]);
            });
            neville(table, previous);
            const double error =
                difference(table.back(), previous, double(step)) / extent(y.x) / settings.tolerance;
            const double growth = 0.9 * std::pow(error, -1.0 / (2 * columns - 1));
            if (error <= 1) {
                std::swap(y, table.back());
                t = double(step * 1.5 + t - target) > 0 ? Real(target) : t + step;
                result.time = double(t);
            }
            H = double(step) * std::clamp(error > 0 ? growth : 4.0, 0.2, 4.0);
            if (H < smallest && double(target - t) > 0) return result;
        }
        place_pins_of_state(system, y, t, double(t) + smallest);
        for (std::size_t k = 0; k < size; ++k) {
            x.push_back(double(y.x[k]));
            v.push_back(double(y.v[k]));
        }
    }
    return result;
}

}  // namespace clothsim::reference
