#include "simulation/gather_engine.hpp"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace clothsim {
namespace {

// Padding holds a point that is far from every cloth, finite when squared in single, and never moves.
constexpr double far_away = 1e15;
constexpr int padding = group_size;  // columns before and after a row; covers a vector and two neighbours

std::ptrdiff_t round_up(std::ptrdiff_t n, std::ptrdiff_t multiple) { return (n + multiple - 1) / multiple * multiple; }

}  // namespace

template <class Real>
GatherEngine<Real>::GatherEngine(const Plan& plan) : plan_(plan), grid_(plan.cloth.grid()) {
    const Cloth& cloth = plan_.cloth;
    const RealKernels<Real>& kernels = plan_.kernels->of<Real>();
    const int features = plan_.features().index();
    kernel_ = plan_.strict ? kernels.gather_strict[features] : kernels.gather[features];
    sphere_kernel_ = kernels.sphere;

    stride_ = round_up(cloth.columns, group_size) + padding;
    origin_ = padding;
    plane_ = padding + cloth.rows * stride_ + padding;

    for (auto* planes : {&state_, &stage_a_, &stage_b_}) {
        planes->assign(6 * plane_, Real(0));
        std::fill_n(planes->begin(), 3 * plane_, Real(far_away));
    }
    if (compensated) compensation_.assign(6 * plane_, Real(0));
    first_acceleration_.assign(3 * plane_, Real(0));
    acceleration_sum_.assign(3 * plane_, Real(0));

    free_.assign(plane_, Real(0));
    row_has_fixed_.assign(cloth.rows, cloth.columns % group_size != 0);
    for (int r = 0; r < cloth.rows; ++r)
        for (int c = 0; c < cloth.columns; ++c) {
            const bool pinned = cloth.pinned[r * cloth.columns + c];
            free_[at(r, c)] = Real(pinned ? 0 : 1);
            row_has_fixed_[r] |= pinned;
        }
    if (cloth.uniform_mass) {
        coefficient_scale_ = 1 / cloth.mass[0];
    } else {
        inverse_mass_.assign(plane_, Real(0));
        for (int r = 0; r < cloth.rows; ++r)
            for (int c = 0; c < cloth.columns; ++c)
                inverse_mass_[at(r, c)] = Real(1 / cloth.mass[r * cloth.columns + c]);
    }
    build_coefficients();
}

template <class Real>
void GatherEngine<Real>::build_coefficients() {
    const Cloth& cloth = plan_.cloth;
    const std::ptrdiff_t width = round_up(cloth.columns, group_size);
    coefficients_.assign(3 * neighbour_count * width, Real(0));
    for (int n = 0; n < neighbour_count; ++n) {
        const Neighbour& neighbour = neighbours[n];
        Real* const stiffness = coefficients_.data() + 3 * n * width;
        Real* const rest_length = stiffness + width;
        Real* const damping = rest_length + width;
        for (int c = 0; c < cloth.columns; ++c) {
            if (c + neighbour.column < 0 || c + neighbour.column >= cloth.columns) continue;
            stiffness[c] = Real(cloth.stiffness[neighbour.family] * coefficient_scale_);
            rest_length[c] = Real(cloth.rest_length(neighbour));
            damping[c] = Real(cloth.spring_damping[neighbour.family] * coefficient_scale_);
        }
        spring_[n] = {stiffness, rest_length, damping};
    }
}

template <class Real>
template <class In>
void GatherEngine<Real>::load_any(const In* x, const In* v) {
    const Cloth& cloth = plan_.cloth;
    const auto put = [&](std::ptrdiff_t where, In value) {
        state_[where] = Real(value);
        if (compensated) compensation_[where] = Real(value - In(state_[where]));
    };
    for (int r = 0; r < cloth.rows; ++r)
        for (int c = 0; c < cloth.columns; ++c) {
            const std::ptrdiff_t in = 3 * (std::ptrdiff_t(r) * cloth.columns + c);
            const bool pinned = cloth.pinned[r * cloth.columns + c];
            for (int k = 0; k < 3; ++k) {
                put(at(r, c) + k * plane_, x[in + k]);
                put(at(r, c) + (3 + k) * plane_, pinned ? In(0) : v[in + k]);
            }
        }
}

template <class Real>
template <class Out>
void GatherEngine<Real>::store_any(Out* x, Out* v) const {
    const Cloth& cloth = plan_.cloth;
    const auto get = [&](std::ptrdiff_t where) {
        return compensated ? Out(double(state_[where]) + double(compensation_[where])) : Out(state_[where]);
    };
    for (int r = 0; r < cloth.rows; ++r)
        for (int c = 0; c < cloth.columns; ++c) {
            const std::ptrdiff_t out = 3 * (std::ptrdiff_t(r) * cloth.columns + c);
            for (int k = 0; k < 3; ++k) {
                x[out + k] = get(at(r, c) + k * plane_);
                v[out + k] = get(at(r, c) + (3 + k) * plane_);
            }
        }
}

template <class Real>
GatherArguments<Real> GatherEngine<Real>::arguments(Stage stage, double dt) {
    GatherArguments<Real> g{};
    g.stride = stride_;
    g.plane = plane_;
    g.rows = plan_.cloth.rows;
    g.columns = plan_.cloth.columns;
    g.stage = stage;
    std::copy(std::begin(spring_), std::end(spring_), std::begin(g.spring));
    for (int k = 0; k < 3; ++k) g.gravity[k] = Real(plan_.gravity[k]);
    g.half_h = Real(dt / 2);
    g.h = Real(dt);
    g.h2_6 = Real(dt * dt / 6);
    g.h_6 = Real(dt / 6);
    g.point_damping = Real(plan_.cloth.point_damping * coefficient_scale_);
    g.inverse_mass = inverse_mass_.empty() ? nullptr : inverse_mass_.data() + origin_;
    g.free = free_.data() + origin_;
    g.row_has_fixed = row_has_fixed_.data();
    Real* const a = stage_a_.data() + origin_;
    Real* const b = stage_b_.data() + origin_;
    g.state = state_.data() + origin_;
    g.source = stage == Stage::first || stage == Stage::evaluate ? g.state : stage == Stage::third ? b : a;
    g.target = stage == Stage::second ? b : a;
    g.compensation = compensated ? compensation_.data() + origin_ : nullptr;
    g.first_acceleration = first_acceleration_.data() + origin_;
    g.acceleration_sum = acceleration_sum_.data() + origin_;
    return g;
}

template <class Real>
void GatherEngine<Real>::advance(std::int64_t steps, const Clock& clock, int threads) {
    const GatherArguments<Real> stages[4] = {arguments(Stage::first, clock.dt), arguments(Stage::second, clock.dt),
                                             arguments(Stage::third, clock.dt), arguments(Stage::fourth, clock.dt)};
    const int groups = grid_.groups();
    const bool collide_apart = track_contact_energy;

    const auto work = [&](int thread, int team, auto&& barrier) {
        const int begin = int(std::int64_t(groups) * thread / team);
        const int end = int(std::int64_t(groups) * (thread + 1) / team);
        std::vector<Contact> contacts;
        contacts.reserve(plan_.spheres.size());
        for (std::int64_t k = 1; k <= steps; ++k) {
            contacts.clear();
            for (const Sphere& sphere : plan_.spheres) contacts.emplace_back(sphere, clock.at(k));
            for (int stage = 0; stage < 4; ++stage) {
                for (int group = begin; group < end; ++group) {
                    const Tile tile = tile_of_group(grid_, group);
                    kernel_(stages[stage], tile);
                    if (stage == 3 && !collide_apart)
                        for (const Contact& contact : contacts) collide(contact, tile);
                }
                barrier();
            }
            if (collide_apart) {
                if (thread == 0)
                    for (const Contact& contact : contacts)
                        collide(contact, {0, grid_.height, 0, grid_.width});
                barrier();
            }
        }
    };

    const int team = std::min(threads, groups);
    if (team == 1) {
        work(0, 1, [] {});
        return;
    }
#pragma omp parallel num_threads(team)
    {
        work(omp_get_thread_num(), omp_get_num_threads(), [] {
#pragma omp barrier
        });
    }
}

template <class Real>
void GatherEngine<Real>::accelerations(double* a, int threads) {
    const GatherArguments<Real> g = arguments(Stage::evaluate, 0);
    const int groups = grid_.groups();
#pragma omp parallel for num_threads(std::min(threads, groups)) if (threads > 1) schedule(static)
    for (int group = 0; group < groups; ++group) kernel_(g, tile_of_group(grid_, group));
    for (int r = 0; r < grid_.height; ++r)
        for (int c = 0; c < grid_.width; ++c)
            for (int k = 0; k < 3; ++k)
                a[3 * (std::ptrdiff_t(r) * grid_.width + c) + k] = double(first_acceleration_[at(r, c) + k * plane_]);
}

template <class Real>
void GatherEngine<Real>::collide(const Contact& contact, const Tile& tile) {
    SphereTest<Real> test{};
    test.stride = stride_;
    test.plane = plane_;
    test.position = state_.data() + origin_;
    for (int k = 0; k < 3; ++k) test.center[k] = Real(contact.center[k]);
    const double radius = contact.sphere.contact_radius;
    // The vector test may only find too many; `answer` decides in double.
    test.radius_squared = Real(radius * radius * (1 + 8 * double(std::numeric_limits<Real>::epsilon())));

    struct Context {
        GatherEngine* engine;
        const Contact* contact;
    } context{this, &contact};
    sphere_kernel_(test, tile, [](void* p, int row, int column) {
        const auto* c = static_cast<Context*>(p);
        c->engine->answer(*c->contact, row, column);
    }, &context);
}

template <class Real>
PointState GatherEngine<Real>::point_state(int row, int column) const {
    const auto value = [&](int component) {
        const std::ptrdiff_t where = at(row, column) + component * plane_;
        return compensated ? double(state_[where]) + double(compensation_[where]) : double(state_[where]);
    };
    return {{value(0), value(1), value(2)}, {value(3), value(4), value(5)}};
}

template <class Real>
double GatherEngine<Real>::spring_energy(int row, int column) const {
    const Cloth& cloth = plan_.cloth;
    const Vec3 here = point_state(row, column).position;
    double energy = 0;
    for (const Neighbour& n : neighbours) {
        const int r = row + n.row, c = column + n.column;
        if (!cloth.present[n.family] || r < 0 || r >= cloth.rows || c < 0 || c >= cloth.columns) continue;
        const double stretch = (point_state(r, c).position - here).norm() - cloth.rest_length(n);
        energy += cloth.stiffness[n.family] / 2 * stretch * stretch;
    }
    return energy;
}

template <class Real>
void GatherEngine<Real>::answer(const Contact& contact, int row, int column) {
    if (column >= grid_.width || plan_.cloth.pinned[row * grid_.width + column]) return;
    const PointState before = point_state(row, column);
    if (!touches(contact, before.position)) return;
    const PointState after = respond(contact, before);
    const double spring_energy_before = track_contact_energy ? spring_energy(row, column) : 0;
    for (int k = 0; k < 6; ++k) {
        const double value = k < 3 ? after.position[k] : after.velocity[k - 3];
        const std::ptrdiff_t where = at(row, column) + k * plane_;
        state_[where] = Real(value);
        if (compensated) compensation_[where] = Real(value - double(state_[where]));
    }
    if (track_contact_energy) {
        const double mass = plan_.cloth.mass[row * grid_.width + column];
        contact_energy += spring_energy(row, column) - spring_energy_before +
                          mass * ((after.velocity.squaredNorm() - before.velocity.squaredNorm()) / 2 -
                                  plan_.gravity.dot(after.position - before.position));
    }
}

template <class Real>
std::int64_t GatherEngine<Real>::first_non_finite() const {
    // A sum is finite only if all its terms are, short of an overflow that the search below clears up.
    Real sum = 0;
#pragma omp simd reduction(+ : sum)
    for (std::ptrdiff_t i = 3 * plane_; i < 6 * plane_; ++i) sum += state_[i] * Real(0);
    Real position_sum = 0;
#pragma omp simd reduction(+ : position_sum)
    for (std::ptrdiff_t i = 0; i < 3 * plane_; ++i) position_sum += state_[i] * Real(0);
    if (sum == 0 && position_sum == 0) return -1;
    for (int r = 0; r < grid_.height; ++r)
        for (int c = 0; c < grid_.width; ++c)
            for (int k = 0; k < 6; ++k)
                if (!std::isfinite(state_[at(r, c) + k * plane_])) return std::int64_t(r) * grid_.width + c;
    return -1;
}

template <class Real>
template <class Visit>
void GatherEngine<Real>::for_each_value(Visit visit) {
    for (auto* planes : {&state_, &compensation_}) {
        if (planes->empty()) continue;
        for (int k = 0; k < 6; ++k)
            for (int r = 0; r < grid_.height; ++r)
                for (int c = 0; c < grid_.width; ++c) visit((*planes)[at(r, c) + k * plane_]);
    }
}

template <class Real>
std::vector<double> GatherEngine<Real>::raw_state() const {
    std::vector<double> raw;
    raw.reserve((compensated ? 12 : 6) * std::size_t(plan_.cloth.points()));
    const_cast<GatherEngine*>(this)->for_each_value([&](Real& value) { raw.push_back(double(value)); });
    return raw;
}

template <class Real>
void GatherEngine<Real>::set_raw_state(const std::vector<double>& raw) {
    auto next = raw.begin();
    for_each_value([&](Real& value) { value = Real(*next++); });
}

template <class Real>
void GatherEngine<Real>::save_checkpoint() {
    checkpoint_.resize(state_.size() + compensation_.size());
    std::copy(compensation_.begin(), compensation_.end(), std::copy(state_.begin(), state_.end(), checkpoint_.begin()));
}

template <class Real>
void GatherEngine<Real>::restore_checkpoint() {
    const auto middle = checkpoint_.begin() + std::ptrdiff_t(state_.size());
    std::copy(checkpoint_.begin(), middle, state_.begin());
    std::copy(middle, checkpoint_.end(), compensation_.begin());
}

template class GatherEngine<float>;
template class GatherEngine<double>;

std::unique_ptr<Engine> make_engine(const Plan& plan) {
    if (plan.precision == Precision::single) return std::make_unique<GatherEngine<float>>(plan);
    return std::make_unique<GatherEngine<double>>(plan);
}

}  // namespace clothsim
