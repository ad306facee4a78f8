// A perturbation carried along a trajectory: e'' = (da/dx) e + part (da/dv) e', the derivative taken at one state and
// applied by a difference of two accelerations. Drift, kick, drift, with the damping of the kick taken at its start:
// stable to the limit of the semi-implicit Euler method.
#include <cmath>
#include <vector>

#include "simulation/simulation.hpp"

namespace clothsim {
namespace {

double rms(const std::vector<double>& values) {
    double sum = 0;
    for (const double value : values) sum += value * value;
    return std::sqrt(sum * 3 / double(values.size()));
}

}  // namespace

void Simulation::carry(const double* x, const double* v, double* e_out, double* w_out, const CarryRequest& request) {
    Engine& engine = *members_[0];
    const std::size_t size = std::size_t(plans_[0].cloth.points()) * 3;
    std::vector<double> e(e_out, e_out + size), w(w_out, w_out + size);
    std::vector<double> here(size), there(size), xs(size), vs(size);
    engine.load(x, v);
    engine.accelerations(here.data(), request.threads);
    const double k = request.duration / double(request.substeps);
    const auto drift = [&] {
        for (std::size_t i = 0; i < size; ++i) e[i] += k / 2 * w[i];
    };
    for (int step = 0; step < request.substeps; ++step) {
        drift();
        const double length = rms(e) + k * rms(w);
        if (length > 0 && std::isfinite(length)) {
            const double scale = request.displacement / length;
            for (std::size_t i = 0; i < size; ++i) {
                xs[i] = x[i] + scale * e[i];
                vs[i] = v[i] + scale * request.damping_part * w[i];
            }
            engine.load(xs.data(), vs.data());
            engine.accelerations(there.data(), request.threads);
            for (std::size_t i = 0; i < size; ++i) w[i] += k / scale * (there[i] - here[i]);
        }
        drift();
    }
    std::copy(e.begin(), e.end(), e_out);
    std::copy(w.begin(), w.end(), w_out);
}

}  // namespace clothsim
