#include "engines/gather_engine.hpp"

#include "memory/threads.hpp"

namespace clothsim {
namespace {

// Visits the groups of a team's thread: one row of groups is one tile. Group by group, a large
// cloth would go from page to page, 64 bytes at a time of each row and component. Along whole rows
// the processor fetches ahead.
template <class Visit>
void for_each_tile(const ThreadGrid& grid, int thread, int team, Visit visit) {
    int begin = int(std::int64_t(grid.groups()) * thread / team);
    const int end = int(std::int64_t(grid.groups()) * (thread + 1) / team);
    while (begin < end) {
        const int next = std::min(end, (begin / grid.groups_x() + 1) * grid.groups_x());
        Tile tile = tile_of_group(grid, begin);
        tile.column_end = tile_of_group(grid, next - 1).column_end;
        visit(tile);
        begin = next;
    }
}

}  // namespace

template <class Real>
GatherEngine<Real>::GatherEngine(const Plan& plan)
    : Base(plan, PaddedLayout(plan.cloth),
           (Base::compensated ? 12 : 6) * PaddedLayout(plan.cloth).plane),
      grid_(plan.cloth.grid()) {
    const Cloth& cloth = plan_.cloth;
    kernel_ = kernels().gather;

    const std::ptrdiff_t plane = layout_.plane;
    stage_a_.assign(6 * plane, Real(0));
    stage_b_.assign(6 * plane, Real(0));
    for (auto* planes : {&memory_, &stage_a_, &stage_b_})
        std::fill_n(planes->begin(), 3 * plane, Real(far_away));
    first_acceleration_.assign(3 * plane, Real(0));
    acceleration_sum_.assign(3 * plane, Real(0));

    free_.assign(plane, Real(0));
    if (!cloth.uniform_mass) inverse_mass_.assign(plane, Real(0));
    row_has_fixed_.assign(cloth.rows, cloth.columns % group_size != 0);
    for (int r = 0; r < cloth.rows; ++r)
        for (int c = 0; c < cloth.columns; ++c) {
            const int point = r * cloth.columns + c;
            free_[layout_.at(r, c)] = Real(cloth.pinned[point] ? 0 : 1);
            row_has_fixed_[r] |= cloth.pinned[point];
            if (!cloth.uniform_mass) inverse_mass_[layout_.at(r, c)] = Real(1 / cloth.mass[point]);
        }
    build_coefficients();
    if (this->has_forces()) this->apply_constant_force();
}

// The kernel adds forces where it divides by masses, see EdgeEngine.
template <class Real>
void GatherEngine<Real>::make_room_for_forces() {
    forces_.resize(3 * layout_.plane, Real(0));
    if (inverse_mass_.empty()) inverse_mass_.assign(layout_.plane, Real(1));
}

template <class Real>
void GatherEngine<Real>::put_forces(const Points& forces, int begin, int end) {
    for (int r = begin, i = r * columns(); r < end; ++r, i += columns())
        kernels().write_points(forces.row(i).data(), this->scale_.data() + i, this->constant_row(i),
                               layout_.row_shape(), forces_.data() + layout_.at(r, 0));
}

template <class Real>
void GatherEngine<Real>::build_coefficients() {
    const Cloth& cloth = plan_.cloth;
    const double scale = coefficient_scale(plan_);
    for (int kind = 0; kind < spring_kind_count; ++kind) {
        const Neighbour& neighbour = spring_kinds[kind];
        spring_[kind] = {Real(cloth.stiffness[neighbour.family] * scale),
                         Real(cloth.rest_length(neighbour)),
                         Real(cloth.spring_damping[neighbour.family] * scale)};
    }

    const int lanes = kernels().lanes;
    lanes_.resize(std::size_t(round_up(cloth.columns, group_size) / lanes));
    for (int column = 0; column < cloth.columns; ++column)
        for (int offset = -stencil_reach; offset <= stencil_reach; ++offset)
            if (offset != 0 && column + offset >= 0 && column + offset < cloth.columns)
                lanes_[std::size_t(column / lanes)].bits[LanesWithNeighbour::index(offset)] |=
                    std::uint16_t(1 << column % lanes);
}

template <class Real>
GatherArguments<Real> GatherEngine<Real>::arguments(Stage stage, double dt) {
    GatherArguments<Real> g{};
    static_cast<StepConstants<Real>&>(g) = step_constants<Real>(plan_, dt, 1);
    g.stride = layout_.stride;
    g.plane = layout_.plane;
    g.rows = rows();
    g.stage = stage;
    std::copy(std::begin(spring_), std::end(spring_), std::begin(g.spring));
    g.features = plan_.features();
    g.lanes = lanes_.data();
    const std::ptrdiff_t origin = layout_.origin;
    g.inverse_mass = inverse_mass_.empty() ? nullptr : inverse_mass_.data() + origin;
    g.applied = forces_.empty() ? nullptr : forces_.data() + origin;
    g.free = free_.data() + origin;
    g.row_has_fixed = row_has_fixed_.data();
    Real* const a = stage_a_.data() + origin;
    Real* const b = stage_b_.data() + origin;
    g.state = memory_.data() + origin;
    g.source = stage == Stage::first || stage == Stage::evaluate ? g.state
        : stage == Stage::third                                  ? b
                                                                 : a;
    g.target = stage == Stage::second ? b : a;
    g.compensation = Base::compensated ? g.state + layout_.compensation() : nullptr;
    g.first_acceleration = first_acceleration_.data() + origin;
    g.acceleration_sum = acceleration_sum_.data() + origin;
    return g;
}

template <class Real>
void GatherEngine<Real>::advance(std::int64_t steps, const Clock& clock, int threads) {
    const GatherArguments<Real> stages[4] = {
        arguments(Stage::first, clock.dt), arguments(Stage::second, clock.dt),
        arguments(Stage::third, clock.dt), arguments(Stage::fourth, clock.dt)};
    const int team = granted_threads(std::min(threads, grid_.groups()));
    this->choose_sides(clock.at(0));
    Barrier barrier(team);
    run_team(team, [&](int thread) {
        constexpr double part[] = {0, 0.5, 0.5, 1};
        constexpr double weight[] = {1. / 6, 1. / 3, 1. / 3, 1. / 6};
        std::vector<PenaltyArguments<Real>> obstacles;
        for (std::int64_t k = 1; k <= steps; ++k) {
            for (int s = 0; s < 4; ++s) {
                GatherArguments<Real> stage = stages[s];
                this->place_obstacles(StageTime::of_stage(clock.at(k - 1), clock.dt, part[s]),
                                      newton_in_sums(), weight[s] * clock.dt, s == 0, obstacles);
                stage.contacts = this->penalty_rows(obstacles, this->contacts);
                for_each_tile(grid_, thread, team, [&](const Tile& tile) { kernel_(stage, tile); });
                barrier.wait();
            }
        }
    });
}

template <class Real>
void GatherEngine<Real>::accelerations(double t, double* a) {
    ContactTally sums = this->contacts;
    std::vector<PenaltyArguments<Real>> obstacles;
    GatherArguments<Real> g = arguments(Stage::evaluate, 0);
    this->choose_sides(t);
    this->place_obstacles(StageTime::at_rest(t), newton_in_sums(), 0, false, obstacles);
    g.contacts = this->penalty_rows(obstacles, sums);
    Barrier single(1);
    this->act(memory_, StageTime::at_rest(t), 0, rows(), single);
    kernel_(g, {0, rows(), 0, columns()});
    for (int r = 0; r < rows(); ++r)
        for (int c = 0; c < columns(); ++c)
            for (int k = 0; k < 3; ++k) *a++ = double(first_acceleration_[layout_.at(r, c, k)]);
}

template <class Real>
FieldLayout GatherEngine<Real>::field() const {
    FieldLayout f{};
    f.runs = 3;
    f.length = int(round_up(columns(), group_size));
    f.origin = f.acceleration_origin = layout_.origin;
    f.row = f.acceleration_row = layout_.stride;
    f.run = f.acceleration_run = layout_.plane;
    f.velocity = 3 * layout_.plane;
    f.compensation = Base::compensated ? layout_.compensation() : 0;
    f.acceleration_size = 3 * layout_.plane;
    return f;
}

template <class Real>
void GatherEngine<Real>::begin_sweep(const Real* state, Real* acceleration, FieldBand<Real>& band) {
    band.gather = arguments(Stage::evaluate, 0);
    band.gather.source = state + layout_.origin;
    band.gather.first_acceleration = acceleration + layout_.origin;
    band.gather.contacts = band.contacts;
}

template <class Real>
int GatherEngine<Real>::sweep_rows(int begin, int end, FieldBand<Real>& band) {
    kernel_(band.gather, {band.row(begin), band.row(end), 0, columns()});
    return end;
}

template class StateEngine<float, PaddedLayout>;
template class StateEngine<double, PaddedLayout>;
template class GatherEngine<float>;
template class GatherEngine<double>;

}  // namespace clothsim
