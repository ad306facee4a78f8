#include "engines/engine.hpp"

#include <cmath>
#include <limits>

namespace clothsim {

bool Engine::advance_in_contact(std::int64_t steps, const Clock& clock, int threads, bool behind_planes) {
    if (!has_contacts()) {
        advance(steps, clock, threads);
        return true;
    }
    Clock now = clock;
    for (const std::int64_t end = clock.steps + steps; now.steps < end; ++now.steps) {
        while (const std::int64_t clear = behind_planes ? clear_steps(now, end - now.steps) : 0) {
            if (!advance_behind_planes(clear, now, threads)) return false;
            now.steps += clear;
            if (now.steps == end) return true;
        }
        keep_state();
        advance(1, now, threads);
        respond(now.at(0), now.at(1), now.dt, threads);
        if (contact_report.trapped >= 0) break;
    }
    return true;
}

void Engine::respond(double t0, double t1, double dt, int threads) {
    const ContactReport report = respond_to_contacts(t0, t1, dt, threads);
    contact_report.note(report);
    if (report.changed) lower(watched.first_contact, t1);  // also of a step that finds no place
}

void Engine::accept_in_contact(double t0, double t1, int threads) {
    if (has_contacts()) {
        save_checkpoint();
        keep_state();
    }
    adaptive()->accept_step(t1);
    if (has_contacts()) respond(t0, t1, t1 - t0, threads);
    if (contact_report.trapped >= 0) return restore_checkpoint();
}

double runaway_speed(const Cloth& cloth, double dt, double stable_dt) {
    if (dt <= stable_dt) return std::numeric_limits<double>::infinity();
    return std::hypot((cloth.rows - 1) * cloth.row_spacing, (cloth.columns - 1) * cloth.column_spacing) / dt;
}

}  // namespace clothsim
