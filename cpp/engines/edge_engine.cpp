// How large cloths stay in cache, and how threads share the rows.
//
// A cloth that fits in cache is swept stage by stage. A larger one uses temporal blocking: the four
// stages follow each other a few rows apart. So a step reads and writes the state about once, and
// results between stages live in a ring of rows. For that ring to stay in cache a wide cloth is cut
// into strips. Strips take each step one after the other (transposed_layout.hpp); every band has
// all of its rows in each strip.
//
// A thread works on a band of rows. The versions of the halo exchange (memory/band_exchange.hpp)
// are the stages of the steps. A stage overwrites its rows in place, so each band copies the two
// rows at a border for its neighbour:
//
//     make rows --> hand: copy into the neighbour's HaloSlot --> signal the stage
//                                                                   |
//     neighbour: wait for the stage, sum springs
#include "engines/edge_engine.hpp"

#include <cstring>
#include <limits>
#include <map>
#include <optional>

#include "memory/band_exchange.hpp"
#include "memory/caches.hpp"

namespace clothsim {
namespace {

using heuristics::rows_at_a_time;
using heuristics::rows_before_use;

// Rows between two stages that follow each other: a row needs the two after it, and a row is
// finished by the next.
constexpr int rows_between_stages = 3;
// Rows of work, from the newest that the first stage makes to the oldest that the last one reads.
constexpr int rows_under_way = 3 * rows_between_stages + 2 + rows_at_a_time;
// The third row finishes the second one, and then the first two may be sent.
constexpr int rows_to_hand = 3;

template <class Real>
constexpr bool compensated = sizeof(Real) == 4;
template <class Real>
constexpr std::ptrdiff_t bytes_of_point =
    (compensated<Real> ? 2 : 1) * StateRecord::count * sizeof(Real);

// Returns the columns of a strip, 0 if the cloth is not cut. A strip in progress holds rows of
// work, one more of state and some of its compensation. The contact pass needs a whole cloth.
template <class Real>
int strip_columns(const Plan& plan) {
    constexpr std::ptrdiff_t rows_of_state =
        rows_under_way + 1 + (compensated<Real> ? 3 + rows_at_a_time : 0);
    constexpr std::ptrdiff_t of_column =
        (rows_of_state * StateRecord::count + rows_under_way * WorkRecord::count) * sizeof(Real);
    const int width = int(bytes_under_way() / of_column);
    const bool small =
        plan.cloth.points() * bytes_of_point<Real> <= heuristics::bytes_in_shared_cache;
    const bool narrow = plan.cloth.columns <= width + width / 16;
    return small || narrow || !plan.spheres.empty() ? 0 : width;
}

// Halo rows received from the neighbouring band, one slot per stage of a step. A slot holds the row
// at the border and, for bend springs, the row behind it. Without damping only positions are
// exchanged.
template <class Real>
struct HaloSlot {
    static constexpr int slots = heuristics::halo_slots;
    AlignedVector<Real> rows;
    int vectors = 0;
    int lanes = 0;
    int row_count = 0;
    int values_read = 0;

    void prepare(const TransposedLayout& layout, const Features& features) {
        vectors = layout.vectors;
        lanes = layout.lanes;
        row_count = features.family[bend] ? 2 : 1;
        values_read = (features.spring_damping ? 6 : 3) * lanes;
        rows.assign(slots * 2 * row_size() + lanes, Real(0));
    }
    std::ptrdiff_t row_size() const { return std::ptrdiff_t(vectors) * WorkRecord::count * lanes; }
    Real* row(std::int64_t stage, int which) {
        return rows.data() + (stage % slots * 2 + which) * row_size();
    }
    void put(std::int64_t stage, const Real* border, const Real* second) {
        // The first stage of a step reads states.
        const int stride = (stage % 4 == 0 ? StateRecord::count : WorkRecord::count) * lanes;
        for (int which = 0; which < row_count; ++which)
            for (int k = 0; k < vectors; ++k)
                std::copy_n((which == 0 ? border : second) + k * stride, values_read,
                            row(stage, which) + k * stride);
    }
};

// Work memory of a thread: rings of rows, and the rows that each of four stages passes on. All
// strips of a thread use it, so it stays in cache.
template <class Real>
struct Workspace {
    AlignedVector<Real> rows, scratch;
};

// The positions of `records` records: where padding stays.
template <class Real>
void place_far_away(Real* first, std::ptrdiff_t records, std::ptrdiff_t stride, int lanes) {
    for (std::ptrdiff_t i = 0; i < records; ++i)
        std::fill_n(first + i * stride, 3 * lanes, Real(far_away));
}

}  // namespace

template <class Real>
struct EdgeEngine<Real>::Band : NeighbouringBand {
    EdgeEngine* engine;
    int strip;
    HaloSlot<Real> from_near, from_far;
    std::shared_ptr<Workspace<Real>> workspace;
    std::vector<EdgeRowPointers<Real>>
        rows;  // in the order of the sweep, and the two of the neighbour behind them
    int lag, several;  // rows between two stages, and of one at a time; all rows: stage by stage
    EdgeArguments<Real> stages[4];
    double stages_dt = std::numeric_limits<double>::quiet_NaN();  // that of `stages`
    std::vector<PenaltyArguments<Real>> obstacles[4];  // at the stages of a step
    std::vector<std::uint64_t> near_rows[4];  // of each row, see PenaltyRows
    std::int64_t step = 0;  // to which the state belongs
    Clock clock;  // of the call
    // Returns the number of a step's stage, counted over all steps.
    std::int64_t version_of_stage(int stage) const { return 4 * step + stage; }

    std::ptrdiff_t work_record_size() const { return WorkRecord::count * engine->layout_.lanes; }
    const Real* source(Stage stage, int row) const {
        return stage == Stage::first ? rows[std::size_t(row)].state : rows[std::size_t(row)].work;
    }
    // Let the rows behind the last be those of the neighbour at a stage.
    void fetch_beyond_far(std::int64_t number) {
        for (int i = 0; i < 2; ++i) {
            EdgeRowPointers<Real>& row_after = rows[std::size_t(size() + i)];
            row_after.state = row_after.work = from_far.row(number, i);
        }
    }
    // Versions are the stages of a call's steps, from 1 on.
    int version(std::int64_t number) const { return int(number - 4 * engine->step_) + 1; }
    Band& neighbour(NeighbouringBand* at) const { return *static_cast<Band*>(at); }
    // Copies the two finished rows at a border to the neighbour, which reads them in stage
    // `number`.
    void hand_rows_to_near_band(std::int64_t number) {
        const Stage next = Stage(number % 4);
        neighbour(near).from_near.put(number, source(next, 0), source(next, 1));
        signal_near(version(number));
    }
    void hand_rows_to_far_band(std::int64_t number) {
        const Stage next = Stage(number % 4);
        const int last = size() - 1;
        neighbour(far).from_far.put(number, source(next, last), source(next, last - 1));
        signal_far(version(number));
    }

    void begin_call() {
        step = engine->step_;
        begin_region();
    }
    void give_border(int r, std::int64_t step) {
        if (r + 1 < size()) engine->halos_.claim(strip, row(r + 1), step);
        engine->halos_.give(strip, row(r), rows[std::size_t(r)].state, step);
    }
    void exchange_halos() {
        for (int r = 0; engine->layout_.strips > 1 && r < size(); ++r) give_border(r, step);
    }
    void take_border(int r) {
        if (r < 0 || r >= size()) return;
        if (r + 1 < size()) engine->halos_.fetch(strip, row(r + 1), step);
        engine->halos_.take(strip, row(r), rows[std::size_t(r)].state, step);
    }
    // Sends the state with which a step begins to the neighbours: with its halo, so the strips
    // beside this one have to be there.
    void send_start() {
        const int n = size();
        const std::int64_t number = 4 * step;
        for (const int row : {0, 1, n - 2, n - 1}) take_border(row);
        if (near) hand_rows_to_near_band(number);
        if (far) hand_rows_to_far_band(number);
    }
};

template <class Real>
EdgeEngine<Real>::EdgeEngine(const Plan& plan, bool in_strips)
    : Base(plan,
           TransposedLayout(plan.cloth, kernels_of<Real>(*plan.kernels).lanes, Base::compensated,
                            in_strips ? strip_columns<Real>(plan) : 0),
           0),
      halos_(layout_) {
    const Cloth& cloth = plan_.cloth;

    // An unaligned load behind the last vector may read one lane past the last record.
    memory_.assign(layout_.size() + layout_.lanes, Real(0));
    const int all_rows = layout_.strips * cloth.rows;
    for (int row = 0; layout_.is_padded() && row < all_rows; ++row)
        place_far_away(memory_.data() + row * layout_.row_size(), layout_.vectors, layout_.stride,
                       layout_.lanes);

    free_.assign(all_rows * layout_.width(), Real(0));
    if (!cloth.uniform_mass) inverse_mass_.assign(free_.size(), Real(0));
    row_has_fixed_.assign(std::size_t(all_rows), layout_.is_padded());
    for (int row = 0; row < all_rows; ++row)
        layout_.for_each_column([&](int c, int k, int lane) {
            const int point =
                row % cloth.rows * cloth.columns + layout_.first_column_of(row / cloth.rows) + c;
            const std::ptrdiff_t place = row * layout_.width() + k * layout_.lanes + lane;
            free_[place] = Real(cloth.pinned[point] ? 0 : 1);
            row_has_fixed_[row] |= cloth.pinned[point];
            if (!cloth.uniform_mass) inverse_mass_[place] = Real(1 / cloth.mass[point]);
        });
    build_coefficients();
    edge_rows_ = kernels().edge(plan_.features(), damped_alike_);
    if (this->has_forces()) this->apply_constant_force();
}

template <class Real>
EdgeEngine<Real>::~EdgeEngine() = default;

template <class Real>
void EdgeEngine<Real>::build_coefficients() {
    const Cloth& cloth = plan_.cloth;
    const double scale = coefficient_scale(plan_);
    const double root_scale = double(kernels().root_scale);
    const std::optional<double> shared = shared_damping<Real>(plan_);
    unit_ = shared.value_or(1);
    damped_alike_ = shared || !plan_.features().spring_damping;

    Real all_bits;
    std::memset(&all_bits, 0xff, sizeof all_bits);
    // Vectors whose lanes have the same springs share a class; there are few. The first has them
    // all.
    std::map<std::vector<int>, int> classes;
    const auto class_of = [&](const std::vector<int>& reach) {
        const auto [place_of_class, is_new] = classes.try_emplace(reach, int(classes.size()));
        if (!is_new) return place_of_class->second;
        for (const Neighbour& neighbour : spring_kinds)
            for (const int field : {0, 1, 2})
                for (const int follow : reach) {
                    const bool exists = follow >= neighbour.column;
                    const double stiffness = cloth.stiffness[neighbour.family] * scale / unit_;
                    const Real tension =
                        Real(stiffness * cloth.rest_length(neighbour) / root_scale);
                    const double damping = cloth.spring_damping[neighbour.family] * scale /
                        (root_scale * root_scale) / unit_;
                    const Real value = field == EdgeCoefficientIndex::stiffness
                        ? stiffness_at_rest<Real>(plan_, neighbour, Real(stiffness), tension)
                        : field == EdgeCoefficientIndex::tension ? tension
                                                                 : Real(damping);
                    coefficients_.push_back(exists ? value : Real(0));
                }
        return place_of_class->second;
    };
    class_of(std::vector<int>(std::size_t(layout_.lanes), 2));
    for (int k = 0; k < layout_.vectors; ++k) {
        std::vector<int>
            reach;  // per lane, how many columns follow (2: enough for every spring), -1: padding
        for (int lane = 0; lane < layout_.lanes; ++lane)
            reach.push_back(std::clamp(layout_.window - 1 - (lane * layout_.vectors + k), -1, 2));
        coefficient_class_.push_back(std::uint8_t(class_of(reach)));
        for (const int columns : {1, 2})
            for (const int follow : reach) reach_.push_back(follow >= columns ? all_bits : Real(0));
    }
    whole_vectors_ = int(std::find_if(coefficient_class_.begin(), coefficient_class_.end(),
                                      [](std::uint8_t of_vector) { return of_vector != 0; }) -
                         coefficient_class_.begin());
    if (layout_.is_padded()) whole_vectors_ = std::min(whole_vectors_, layout_.vectors - 3);
}

// The kernel adds forces where it divides by masses, so that a cloth without either pays for
// neither.
template <class Real>
void EdgeEngine<Real>::make_room_for_forces() {
    if (!forces_.empty()) return;
    const std::ptrdiff_t all_rows = layout_.strips * rows();
    forces_.assign(3 * all_rows * layout_.width(), Real(0));
    if (inverse_mass_.empty()) inverse_mass_.assign(all_rows * layout_.width(), Real(1));
    bands_.clear();  // they point to both
}

template <class Real>
void EdgeEngine<Real>::put_forces(const Points& forces, int begin, int end) {
    for (int strip = 0; strip < layout_.strips; ++strip)
        for (int row = begin; row < end; ++row) {
            const int i = row * columns() + layout_.first_column_of(strip);
            Real* const to =
                forces_.data() + 3 * (std::ptrdiff_t(strip) * rows() + row) * layout_.width();
            kernels().write_points(forces.row(i).data(), this->scale_.data() + i,
                                   this->constant_row(i), layout_.shape(3), to);
        }
}

template <class Real>
EdgeArguments<Real> EdgeEngine<Real>::arguments(Stage stage, double dt, Real* scratch) const {
    EdgeArguments<Real> e{};
    static_cast<StepConstants<Real>&>(e) = step_constants<Real>(plan_, dt, unit_);
    // Springs evaluated from one end or the other may differ in the sign of a zero; +0 is added, so
    // the bits do not.
    for (Real& g : e.gravity) g += Real(0);
    e.vectors = layout_.vectors;
    e.compensation = layout_.compensation();
    e.stage = stage;
    e.features = plan_.features();
    e.coefficients = coefficients_.data();
    e.coefficient_class = coefficient_class_.data();
    e.reach = reach_.data();
    e.whole_vectors = whole_vectors_;
    e.received[0] = scratch;
    e.received[1] = scratch + handed_size();
    e.received_2 = scratch + 2 * handed_size();
    e.pending = -1;
    e.force = scratch + 3 * handed_size();
    return e;
}

template <class Real>
auto EdgeEngine<Real>::bands(int team) -> std::vector<std::unique_ptr<Band>>& {
    auto& bands = bands_[team];
    if (!bands.empty()) return bands;
    const std::ptrdiff_t work_row = layout_.vectors * WorkRecord::count * layout_.lanes;
    for (int strip = 0; strip < layout_.strips; ++strip)
        for (auto& band : bands_of<Band>(rows(), team)) {
            band->strip = strip;
            bands.push_back(std::move(band));
        }
    for (std::size_t i = 0; i < bands.size(); ++i) {
        Band* const band = bands[i].get();
        band->engine = this;
        band->from_near.prepare(layout_, plan_.features());
        band->from_far.prepare(layout_, plan_.features());

        const int n = band->size();
        const std::ptrdiff_t bytes =
            n * (layout_.row_size() + work_row) * std::ptrdiff_t(sizeof(Real));
        const bool in_cache = bytes <= bytes_kept_in_cache();
        band->lag = in_cache ? n : rows_between_stages;
        band->several = in_cache ? n : rows_at_a_time;
        const int ring = in_cache ? n : std::min(n, rows_under_way);
        if (band->strip == 0) {
            band->workspace = std::make_shared<Workspace<Real>>();
            band->workspace->scratch.assign(4 * scratch_size(), Real(0));
            band->workspace->rows.assign(ring * work_row + layout_.lanes, Real(0));
            place_far_away(band->workspace->rows.data(), ring * layout_.vectors,
                           band->work_record_size(), layout_.lanes);
        } else {
            band->workspace = bands[i - std::size_t(team)]->workspace;
        }
        for (int j = 0; j < n; ++j)
            band->rows.push_back(row_pointers(memory_.data() + band->strip * layout_.strip_size() +
                                                  band->row(j) * layout_.row_size(),
                                              band->workspace->rows.data() + j % ring * work_row,
                                              band->row(j), band->strip));
        band->rows.resize(std::size_t(n + 2));
    }
    return bands;
}

// A stage begins with what the rows before the band hand on.
template <class Real>
void EdgeEngine<Real>::begin_stage(Band& band, int s) {
    EdgeArguments<Real>& e = band.stages[s];
    if (!band.near) {
        std::fill_n(e.received[0], handed_size(), Real(0));
        std::fill_n(e.received_2, handed_size(), Real(0));
        return;
    }
    const std::int64_t number = band.version_of_stage(s);
    band.wait_near(band.version(number));
    const Real* const first = band.source(e.stage, 0);
    kernels().edge_halo(e, {band.from_near.row(number, 1), nullptr, first},
                        {band.from_near.row(number, 0), first, band.source(e.stage, 1)});
}

// Takes rows [begin, end) through a stage.
template <class Real>
void EdgeEngine<Real>::run_rows(Band& band, int s, int begin, int end) {
    const int n = band.size();
    const int end_inner = std::min(end, n - 2);
    const std::int64_t number = band.version_of_stage(s);
    const auto run_to = [&](int row) {
        if (begin >= row) return;
        sum_rows(edge_rows_, band.stages[s], begin, row);
        end_pins(band, s, std::max(begin - 1, 0), row - 1);
        begin = row;
    };
    if (begin == 0 && band.near) begin_stage(band, s);
    if (band.near && begin < rows_to_hand) {
        run_to(std::min(end, rows_to_hand));
        if (begin == rows_to_hand && hands_on(s)) band.hand_rows_to_near_band(number + 1);
    }
    run_to(end_inner);
    if (end > end_inner) run_last_rows(band, s, std::max(begin, end_inner), end);
}

// Takes some of the last two rows through a stage.
template <class Real>
void EdgeEngine<Real>::run_last_rows(Band& band, int s, int begin, int end) {
    EdgeArguments<Real>& e = band.stages[s];
    const int n = band.size();
    const std::int64_t number = band.version_of_stage(s);
    if (band.far) {
        band.wait_far(band.version(number));
        band.fetch_beyond_far(number);
    }
    sum_rows(band.far ? edge_rows_ : kernels().edge_of_any, e, begin, end);
    if (end == n) kernels().edge_finish(e);
    end_pins(band, s, std::max(begin - 1, 0), end < n ? end - 1 : n);
    if (end == n && band.far && hands_on(s)) band.hand_rows_to_far_band(number + 1);
}

template <class Real>
void EdgeEngine<Real>::end_pins(Band& band, int s, int begin, int end) {
    if (!plan_.has_driven_pins() || begin >= end) return;
    const std::int64_t before = band.step - step_;
    const double dt = band.clock.dt;
    const StageTime time = s == 3
        ? StageTime::of_end(band.clock.at(before + 1), dt)
        : StageTime::of_stage(band.clock.at(before), dt, s == 2 ? 1 : 0.5);
    const auto [first, last] = band.RowBand::rows(begin, end);
    const int start = layout_.first_column_of(band.strip);
    const int own = layout_.first_own_column_of(band.strip);
    const int own_end = layout_.first_own_column_of(band.strip + 1);
    plan_.each_driven_pin(
        time, first * columns(), last * columns(),
        [&](int point, const Vec3& place, const Vec3& velocity) {
            const int row = point / columns();
            const int column = point % columns();
            const int in_window = column - start;
            if (s == 3) {
                if (column >= own && column < own_end)
                    this->points_.set(memory_, point, {place - this->origin_, velocity});
            } else if (in_window >= 0 && in_window < layout_.window) {
                const int i = band.upwards ? band.end - 1 - row : row - band.begin;
                Real* const work = band.rows[std::size_t(i)].work +
                    in_window % layout_.vectors * band.work_record_size() +
                    in_window / layout_.vectors;
                for (int k = 0; k < 3; ++k) {
                    work[k * layout_.lanes] = Real(place[k] - this->origin_[k]);
                    work[(3 + k) * layout_.lanes] = Real(velocity[k]);
                }
            }
        });
}

template <class Real>
void EdgeEngine<Real>::place_contacts(Band& band) {
    constexpr double part[] = {0, 0.5, 0.5, 1};
    constexpr double weight[] = {1. / 6, 1. / 3, 1. / 3, 1. / 6};
    const double t = band.clock.at(band.step - step_);
    const double dt = band.clock.dt;
    if (band.step > step_ && !this->obstacles_move())
        return this->set_obstacle_times(t, band.obstacles[0]);
    for (int s = 0; s < 4; ++s) {
        this->place_obstacles(StageTime::of_stage(t, dt, part[s]), newton_in_sums(), weight[s] * dt,
                              s == 0, band.obstacles[s]);
        band.stages[s].contacts = this->penalty_rows(band.obstacles[s], this->contacts);
        band.near_rows[s].resize(std::size_t(band.size()));
        band.stages[s].contacts.near = band.near_rows[s].data();
    }
}

template <class Real>
void EdgeEngine<Real>::step_band(Band& band) {
    const int n = band.size();
    if (this->has_penalty()) place_contacts(band);
    const bool strips = layout_.strips > 1;
    if (!band.near)
        for (int s = 0; s < 4; ++s) begin_stage(band, s);
    for (int front = 0, done = 0; front < n + 3 * band.lag; front += band.several) {
        for (int row = front + 2; strips && row < std::min(front + 2 + band.several, n - 2); ++row)
            band.take_border(row);
        for (int s = 0; s < 4; ++s) {
            const int begin = front - s * band.lag;
            const int end = std::min(begin + band.several, n);
            if (begin < n && end > 0) run_rows(band, s, std::max(begin, 0), end);
        }
        // A row is finished with the next one, the last by itself.
        const int front_row = std::min(front - 3 * band.lag + band.several, n);
        const int last_complete = front_row == n ? n : std::max(front_row - 1, 0);
        for (int row = done; strips && row < last_complete; ++row)
            band.give_border(row, band.step + 1);
        done = last_complete;
    }
    ++band.step;
}

// Takes some steps: the part of a team's thread.
template <class Real>
void EdgeEngine<Real>::run_bands(int team, int thread, std::int64_t steps, const Clock& clock) {
    const auto& all = bands(team);
    const auto band = [&](int strip) -> Band& { return *all[std::size_t(strip * team + thread)]; };
    for (int strip = 0; strip < layout_.strips; ++strip) {
        Band& b = band(strip);
        b.clock = clock;
        for (int s = 0; s < 4 && b.stages_dt != clock.dt; ++s) {
            EdgeArguments<Real>& e = b.stages[s] =
                arguments(Stage(s), clock.dt, b.workspace->scratch.data() + s * scratch_size());
            e.rows = b.rows.data();
            if (b.lag == b.size()) continue;
            // Each stage fetches a part of the row that the first stage reaches next. Stages that
            // read the compensation of positions and of velocities fetch half of it instead. They
            // need it one row later, where a row is finished.
            const int sharing = Base::compensated ? 2 : 4;
            const bool compensation = s >= sharing;
            const std::ptrdiff_t part = layout_.stride / sharing;
            e.ahead = compensation ? 1 : s * b.lag + rows_before_use + b.several - 1;
            e.ahead_begin = (compensation ? layout_.compensation() : 0) + s % sharing * part;
            e.ahead_end = e.ahead_begin + part;
            e.row_count = b.size();
        }
        b.stages_dt = clock.dt;
        if (!this->state_known_) b.exchange_halos();
    }
    const int last = layout_.strips - 1;
    for (int strip = 0; strip <= last; ++strip) band(strip).send_start();
    for (std::int64_t k = 1; k <= steps; ++k) {
        // A strip passes the state of its next step on as soon as the strip behind it has taken
        // this one. So threads need not wait for each other at each strip.
        for (int strip = 0; strip <= last; ++strip) {
            step_band(band(strip));
            if (strip > 0) band(strip - 1).send_start();
        }
        if (last > 0) band(last).send_start();
    }
}

template <class Real>
void EdgeEngine<Real>::advance(std::int64_t steps, const Clock& clock, int threads) {
    const int team = granted_threads(RowBand::team(rows(), threads));
    this->choose_sides(clock.at(0));
    for (const auto& band : bands(team)) band->begin_call();
    run_team(team, [&](int thread) { run_bands(team, thread, steps, clock); });
    step_ += steps;
    this->state_known_ = true;
}

template <class Real>
void EdgeEngine<Real>::accelerations(double t, double* a) {
    const FieldLayout f = field();
    AlignedVector<Real> accelerations(std::size_t(f.acceleration_size), Real(0));
    const bool strips = layout_.strips > 1;
    for (int strip = 0; strips && strip < layout_.strips; ++strip) {
        Band& band = *bands(1)[std::size_t(strip)];
        band.begin_call();
        if (!this->state_known_) band.exchange_halos();
    }
    FieldBand<Real> all;
    all.end = rows();
    ContactTally sums = this->contacts;
    this->choose_sides(t);
    this->place_obstacles(StageTime::at_rest(t), newton_in_sums(), 0, false, all.obstacles);
    all.contacts = this->penalty_rows(all.obstacles, sums);
    Barrier single(1);
    this->act(memory_, StageTime::at_rest(t), 0, rows(), single);
    for (int strip = 0; strip < layout_.strips; ++strip) {
        for (int r = 0; strips && r < rows(); ++r) bands(1)[std::size_t(strip)]->take_border(r);
        begin_sweep(memory_.data() + strip * layout_.strip_size(), accelerations.data(), all,
                    strip);
        sweep_rows(0, rows(), all);
        const int own = layout_.first_own_column_of(strip);
        const int own_end = layout_.first_own_column_of(strip + 1);
        std::vector<std::ptrdiff_t> places;  // of columns in a row of accelerations
        for (int c = own - layout_.first_column_of(strip);
             c < own_end - layout_.first_column_of(strip); ++c)
            places.push_back(c % layout_.vectors * f.acceleration_run + c / layout_.vectors);
        for (int r = 0; r < rows(); ++r) {
            double* to = a + 3 * (std::ptrdiff_t(r) * columns() + own);
            for (const std::ptrdiff_t place : places)
                for (int k = 0; k < 3; ++k)
                    *to++ = double(accelerations[std::size_t(r * f.acceleration_row + place +
                                                             k * layout_.lanes)]);
        }
    }
}

template <class Real>
FieldLayout EdgeEngine<Real>::field() const {
    const std::ptrdiff_t lanes = layout_.lanes;
    FieldLayout f{};
    f.runs = layout_.vectors;
    f.length = 3 * layout_.lanes;
    f.row = layout_.row_size();
    f.run = layout_.stride;
    f.velocity = 3 * lanes;
    f.compensation = Base::compensated ? layout_.compensation() : 0;
    f.acceleration_row = layout_.vectors * 3 * lanes;
    f.acceleration_run = 3 * lanes;
    // There is a record more: equal places of slopes would share a set of the nearest cache.
    f.acceleration_size = rows() * f.acceleration_row + f.acceleration_run;
    return f;
}

template <class Real>
void EdgeEngine<Real>::begin_sweep(const Real* state, Real* acceleration, FieldBand<Real>& band,
                                   int strip) {
    band.values.resize(std::size_t(scratch_size()));
    // The band and the two rows after it, which its last rows read. The stage only reads their
    // state.
    const auto exists = [&](int i) { return band.row(i) >= 0 && band.row(i) < rows(); };
    const int n = band.size();
    band.pointers.assign(std::size_t(n + 2), {});
    for (int i = 0; i < n + 2 && exists(i); ++i)
        band.pointers[std::size_t(i)] = row_pointers(
            const_cast<Real*>(state) + band.row(i) * layout_.row_size(),
            acceleration + band.row(i) * layout_.vectors * 3 * layout_.lanes, band.row(i), strip);
    EdgeArguments<Real>& e = band.edge = arguments(Stage::evaluate, 0, band.values.data());
    e.rows = band.pointers.data();
    e.contacts = band.contacts;
    band.near_rows.resize(std::size_t(n));
    e.contacts.near = band.near_rows.data();
    if (n * layout_.row_size() * std::ptrdiff_t(sizeof(Real)) > bytes_kept_in_cache()) {
        e.ahead = rows_before_use;
        e.ahead_end = layout_.stride;
        e.row_count = n;
    }

    const auto source = [&](int i) { return state + band.row(i) * layout_.row_size(); };
    if (!exists(-1)) std::fill_n(e.received[0], 3 * handed_size(), Real(0));
    else
        kernels().edge_halo(e, {source(-2), nullptr, source(0)},
                            {source(-1), source(0), source(1)});
}

template <class Real>
int EdgeEngine<Real>::sweep_rows(int begin, int end, FieldBand<Real>& band) {
    const int n = band.size();
    const int whole = band.pointers[std::size_t(n)].state ? n : n - 2;
    const int inner = std::clamp(whole, begin, end);
    sum_rows(edge_rows_, band.edge, begin, inner);
    sum_rows(kernels().edge_of_any, band.edge, inner, end);
    if (end < n) return end - 1;  // the kernel finishes a row with the next one
    kernels().edge_finish(band.edge);
    return end;
}

template class StateEngine<float, TransposedLayout>;
template class StateEngine<double, TransposedLayout>;
template class EdgeEngine<float>;
template class EdgeEngine<double>;

}  // namespace clothsim
