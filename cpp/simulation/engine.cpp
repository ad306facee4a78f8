#include "simulation/edge_engine.hpp"
#include "simulation/gather_engine.hpp"
#include "simulation/stability.hpp"

namespace clothsim {
namespace {

template <class Real>
std::unique_ptr<Engine> make(const Plan& plan) {
    if (plan.kernel == Kernel::gather) return std::make_unique<GatherEngine<Real>>(plan);
    return std::make_unique<EdgeEngine<Real>>(plan);
}

}  // namespace

void Engine::advance_in_contact(std::int64_t steps, const Clock& clock, int threads) {
    if (!has_continuous()) {
        advance(steps, clock, threads);
        return;
    }
    Clock now = clock;
    for (std::int64_t k = 0; k < steps; ++k, ++now.steps) {
        keep_state();
        advance(1, now, threads);
        const double before = track_contact_energy ? total_energy() : 0;
        const ContactReport report = answer_contacts(now.at(0), now.at(1), now.dt, threads);
        if (track_contact_energy) contact_energy += total_energy() - before;
        if (report.pinned_inside >= 0) contact_report.note_pinned(report.pinned_inside);
        if (report.shut_in >= 0) {
            contact_report.note_shut_in(report.shut_in);
            return;
        }
    }
}

double runaway_speed(const Cloth& cloth, double dt) {
    if (dt <= rk4_stable_dt(cloth)) return std::numeric_limits<double>::infinity();
    return std::hypot((cloth.rows - 1) * cloth.row_spacing, (cloth.columns - 1) * cloth.column_spacing) / dt;
}

std::unique_ptr<Engine> make_engine(const Plan& plan) {
    return plan.precision == Precision::single ? make<float>(plan) : make<double>(plan);
}

}  // namespace clothsim
