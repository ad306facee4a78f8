// How large cloths stay in cache. Threads exchange halo rows as memory/band_exchange.hpp explains.
//
// A cloth that fits in cache is swept stage by stage. A larger one uses temporal blocking: the four stages
// follow each other a few rows apart. So a step reads and writes the state about once, and results between
// stages live in a ring of rows. For that ring to stay in cache a wide cloth is cut into strips. Strips take
// each step one after the other (transposed_layout.hpp); every band has all of its rows in each strip.
#include <cstring>
#include <map>
#include <optional>

#include "engines/edge_band.hpp"
#include "memory/caches.hpp"

namespace clothsim {
namespace {

// Rows between two stages that follow each other: a row needs the two after it, and a row is finished by the
// next.
constexpr int rows_between_stages = 3;
// Rows of a stage before the next stage continues. Each stage has code of its own, too much to change with
// every row.
constexpr int rows_at_a_time = 4;
// Of work, from the newest that the first stage makes to the oldest that the last one reads.
constexpr int rows_under_way = 3 * rows_between_stages + 2 + rows_at_a_time;
// The third row finishes the second one, and then the first two may be sent.
constexpr int rows_to_hand = 3;

template <class Real>
constexpr bool compensated = sizeof(Real) == 4;
template <class Real>
constexpr std::ptrdiff_t bytes_of_point = (compensated<Real> ? 2 : 1) * StateRecord::count * sizeof(Real);

// Columns of a strip, 0: the cloth is not cut. A strip in progress holds rows of work, one more of state and
// some of its compensation. The contact pass needs a whole
// cloth.
template <class Real>
int strip_columns(const Plan& plan) {
    constexpr std::ptrdiff_t rows_of_state =
        rows_under_way + 1 + (compensated<Real> ? 3 + rows_at_a_time : 0);
    constexpr std::ptrdiff_t of_column =
        (rows_of_state * StateRecord::count + rows_under_way * WorkRecord::count) * sizeof(Real);
    const int enough = int(bytes_under_way() / of_column);
    const bool small = plan.cloth.points() * bytes_of_point<Real> <= bytes_in_shared_cache;
    const bool narrow = plan.cloth.columns <= enough + enough / 16;
    return small || narrow || !plan.spheres.empty() ? 0 : enough;
}

// The positions of `records` records: where padding stays.
template <class Real>
void place_far_away(Real* first, std::ptrdiff_t records, std::ptrdiff_t stride, int lanes) {
    for (std::ptrdiff_t i = 0; i < records; ++i) std::fill_n(first + i * stride, 3 * lanes, Real(far_away));
}

}  // namespace

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
    for (int row = 0; layout_.padded() && row < all_rows; ++row)
        place_far_away(memory_.data() + row * layout_.row_size(), layout_.vectors, layout_.stride,
                       layout_.lanes);

    free_.assign(all_rows * layout_.width(), Real(0));
    if (!cloth.uniform_mass) inverse_mass_.assign(free_.size(), Real(0));
    row_has_fixed_.assign(std::size_t(all_rows), layout_.padded());
    for (int row = 0; row < all_rows; ++row)
        layout_.for_each_column([&](int c, std::ptrdiff_t in_row) {
            const int point = row % cloth.rows * cloth.columns + layout_.start(row / cloth.rows) + c;
            const std::ptrdiff_t place = row * layout_.width() + in_row;
            free_[place] = Real(cloth.pinned[point] ? 0 : 1);
            row_has_fixed_[row] |= cloth.pinned[point];
            if (!cloth.uniform_mass) inverse_mass_[place] = Real(1 / cloth.mass[point]);
        });
    for (int k = 0; k < layout_.vectors; ++k)
        for (int component = 0; component < 3; ++component)
            acceleration_place_.push_back((k * WorkRecord::count + WorkRecord::first + component) *
                                          layout_.lanes);
    build_coefficients();
    edge_ = kernels().edge(plan_.features(), damped_alike_);
    if (plan_.has_force()) EdgeEngine::apply_force();
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
    // Vectors whose lanes have the same springs share a class; there are few. The first has them all.
    std::map<std::vector<int>, int> classes;
    const auto class_of = [&](const std::vector<int>& reach) {
        const auto [found, is_new] = classes.try_emplace(reach, int(classes.size()));
        if (!is_new) return found->second;
        for (const Neighbour& neighbour : spring_kinds)
            for (const int what : {0, 1, 2})
                for (const int follow : reach) {
                    const bool there = follow >= neighbour.column;
                    const double stiffness = cloth.stiffness[neighbour.family] * scale / unit_;
                    const Real tension = Real(stiffness * cloth.rest_length(neighbour) / root_scale);
                    const double damping =
                        cloth.spring_damping[neighbour.family] * scale / (root_scale * root_scale) / unit_;
                    const Real value = what == EdgeCoefficientIndex::stiffness
                        ? stiffness_at_rest<Real>(plan_, neighbour, Real(stiffness), tension)
                        : what == EdgeCoefficientIndex::tension ? tension
                                                                : Real(damping);
                    coefficients_.push_back(there ? value : Real(0));
                }
        return found->second;
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
    if (layout_.padded()) whole_vectors_ = std::min(whole_vectors_, layout_.vectors - 3);
}

// The kernel adds forces where it divides by masses, so that a cloth without either pays for neither.
template <class Real>
void EdgeEngine<Real>::apply_force() {
    const std::ptrdiff_t all_rows = layout_.strips * rows();
    if (applied_.empty()) {
        applied_.assign(3 * all_rows * layout_.width(), Real(0));
        if (inverse_mass_.empty()) inverse_mass_.assign(all_rows * layout_.width(), Real(1));
        bands_.clear();  // they point to both
    }
    for (std::ptrdiff_t row = 0; row < all_rows; ++row)
        layout_.for_each_column([&](int c, std::ptrdiff_t in_row) {
            const int point = int(row) % rows() * columns() + layout_.start(int(row) / rows()) + c;
            const Vec3 applied = this->applied_at(point) / unit_;
            const std::ptrdiff_t lanes = layout_.lanes, vector = in_row / lanes, lane = in_row % lanes;
            for (int j = 0; j < 3; ++j)
                applied_[3 * row * layout_.width() + (3 * vector + j) * lanes + lane] = Real(applied[j]);
        });
}

template <class Real>
EdgeArguments<Real> EdgeEngine<Real>::arguments(Stage stage, double dt, Real* scratch) const {
    EdgeArguments<Real> e{};
    static_cast<StepConstants<Real>&>(e) = step_constants<Real>(plan_, dt, unit_);
    // Springs evaluated from one end or the other may differ in the sign of a zero; +0 is added, so the bits
    // do not.
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
        const std::ptrdiff_t bytes = n * (layout_.row_size() + work_row) * std::ptrdiff_t(sizeof(Real));
        const bool in_cache = bytes <= bytes_kept_in_cache();
        band->lag = in_cache ? n : rows_between_stages;
        band->several = in_cache ? n : rows_at_a_time;
        const int ring = in_cache ? n : std::min(n, rows_under_way);
        if (band->strip == 0) {
            band->workspace = std::make_shared<Workspace<Real>>();
            band->workspace->scratch.assign(4 * scratch_size(), Real(0));
            band->workspace->rows.assign(ring * work_row + layout_.lanes, Real(0));
            place_far_away(band->workspace->rows.data(), ring * layout_.vectors, band->work_stride(),
                           layout_.lanes);
        } else {
            band->workspace = bands[i - std::size_t(team)]->workspace;
        }
        for (int j = 0; j < n; ++j)
            band->rows.push_back(row_pointers(memory_.data(),
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
    const std::int64_t number = band.number_of(s);
    band.wait_near(band.version(number));
    const Real* const first = band.source(e.stage, 0);
    edge_.halo(e, {band.from_near.row(number, 1), nullptr, first},
               {band.from_near.row(number, 0), first, band.source(e.stage, 1)});
}

// Rows [begin, end) of a stage.
template <class Real>
void EdgeEngine<Real>::run_rows(Band& band, int s, int begin, int end) {
    const int n = band.size(), end_inner = std::min(end, n - 2);
    const std::int64_t number = band.number_of(s);
    const auto run_to = [&](int row) {
        if (begin >= row) return;
        edge_.rows(band.stages[s], begin, row);
        end_pins(band, s, std::max(begin - 1, 0), row - 1);
        begin = row;
    };
    if (begin == 0 && band.near) begin_stage(band, s);
    if (band.near && begin < rows_to_hand) {
        run_to(std::min(end, rows_to_hand));
        if (begin == rows_to_hand && hands_on(s)) band.hand_near(number + 1);
    }
    run_to(end_inner);
    if (end > end_inner) run_last_rows(band, s, std::max(begin, end_inner), end);
}

// Some of the last two rows.
template <class Real>
void EdgeEngine<Real>::run_last_rows(Band& band, int s, int begin, int end) {
    EdgeArguments<Real>& e = band.stages[s];
    const int n = band.size();
    const std::int64_t number = band.number_of(s);
    if (band.far) {
        band.wait_far(band.version(number));
        band.fetch_beyond_far(number);
        edge_.rows(e, begin, end);
    }
    for (int row = begin; row < end && !band.far; ++row)
        edge_.last_row(
            e, row,
            {band.source(e.stage, row), row + 1 < n ? band.source(e.stage, row + 1) : nullptr, nullptr});
    if (end == n) kernels().edge_finish(e);
    end_pins(band, s, std::max(begin - 1, 0), end < n ? end - 1 : n);
    if (end == n && band.far && hands_on(s)) band.hand_far(number + 1);
}

template <class Real>
void EdgeEngine<Real>::end_pins(Band& band, int s, int begin, int end) {
    if (!plan_.has_driven_pins() || begin >= end) return;
    const std::int64_t before = band.step - step_;
    const double dt = band.clock.dt;
    const PinTime time = s == 3 ? PinTime::of_end(band.clock.at(before + 1), dt)
                                : PinTime::of_stage(band.clock.at(before), dt, s == 2 ? 1 : 0.5);
    const auto [first, last] = band.RowBand::rows(begin, end);
    const int start = layout_.start(band.strip), own = layout_.own(band.strip),
              own_end = layout_.own(band.strip + 1);
    plan_.each_driven_pin(
        time, first * columns(), last * columns(), [&](int point, const Vec3& place, const Vec3& velocity) {
            const int row = point / columns(), column = point % columns(), in_window = column - start;
            if (s == 3) {
                if (column >= own && column < own_end)
                    this->points_.set(memory_, point, {place - this->origin_, velocity});
            } else if (in_window >= 0 && in_window < layout_.window) {
                const int i = band.upwards ? band.end - 1 - row : row - band.begin;
                Real* const work = band.rows[std::size_t(i)].work +
                    in_window % layout_.vectors * band.work_stride() + in_window / layout_.vectors;
                for (int k = 0; k < 3; ++k) {
                    work[k * layout_.lanes] = Real(place[k] - this->origin_[k]);
                    work[(3 + k) * layout_.lanes] = Real(velocity[k]);
                }
            }
        });
}

template <class Real>
void EdgeEngine<Real>::step_band(Band& band, bool inspect) {
    const int n = band.size();
    const bool strips = layout_.strips > 1;
    if (!band.near)
        for (int s = 0; s < 4; ++s) begin_stage(band, s);
    for (int front = 0, done = 0; front < n + 3 * band.lag; front += band.several) {
        for (int row = front + 2; strips && row < std::min(front + 2 + band.several, n - 2); ++row)
            band.take_border(row);
        for (int s = 0; s < 4; ++s) {
            const int begin = front - s * band.lag, end = std::min(begin + band.several, n);
            if (begin < n && end > 0) run_rows(band, s, std::max(begin, 0), end);
        }
        // A row is finished with the next one, the last by itself.
        const int made = std::min(front - 3 * band.lag + band.several, n),
                  finished = made == n ? n : std::max(made - 1, 0);
        for (int row = done; strips && row < finished; ++row) band.give_border(row, band.step + 1);
        if (inspect && done < finished) band.inspect(done, finished);
        const auto [first, end] = band.RowBand::rows(done, finished);
        this->watch(first, end);
        done = finished;
    }
    ++band.step;
}

// The part of a team's thread in some steps.
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
            // Each stage fetches a part of the row that the first stage reaches next. Stages that read the
            // compensation of positions and of velocities fetch half of it instead. They need it one row
            // later, where a row is finished.
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
    const bool inspect = !moved_after_steps();
    const int last = layout_.strips - 1;
    for (int strip = 0; strip <= last; ++strip) band(strip).send_start();
    for (std::int64_t k = 1; k <= steps; ++k) {
        // A strip passes the state of its next step on as soon as the strip behind it has taken this one. So
        // threads need not wait for each other at each strip.
        for (int strip = 0; strip <= last; ++strip) {
            step_band(band(strip), inspect && k == steps);
            if (strip > 0) band(strip - 1).send_start();
        }
        if (last > 0) band(last).send_start();
    }
}

template <class Real>
void EdgeEngine<Real>::advance(std::int64_t steps, const Clock& clock, int threads) {
    this->known_finite_ = false;
    const int team = granted_threads(RowBand::team(rows(), threads));
    const auto& stepped = bands(team);
    for (const auto& band : stepped) band->begin_call();
    run_team(team, [&](int thread) { run_bands(team, thread, steps, clock); });
    step_ += steps;
    this->state_known_ = true;
    this->known_finite_ = steps > 0 && !moved_after_steps() &&
        std::all_of(stepped.begin(), stepped.end(), [](const auto& band) { return band->finite; });
}

template <class Real>
void EdgeEngine<Real>::accelerations(double* a, int) {
    const auto& take = kernels().state_rows.of_double.take_transposed;
    AlignedVector<double> window(std::size_t(layout_.in_one_strip() ? 0 : 3 * layout_.window));
    for (auto& band : bands(1)) {
        band->begin_call();
        if (!this->state_known_) band->exchange_halos();
    }
    for (int strip = 0; strip < layout_.strips; ++strip) {
        Band& band = *bands(1)[std::size_t(strip)];
        for (int r = 0; r < rows(); ++r) band.take_border(r);
        EdgeArguments<Real> e = arguments(Stage::evaluate, 0, band.workspace->scratch.data());
        // A row is finished with the next one, and then taken out of a ring of work that stays in the nearest
        // cache.
        std::vector<EdgeRowPointers<Real>> sweep = band.rows;
        const int ring = std::min(rows(), rows_at_a_time + 1);
        for (int r = 0; r < rows(); ++r)
            sweep[std::size_t(r)].work =
                band.workspace->rows.data() + r % ring * layout_.vectors * band.work_stride();
        e.rows = sweep.data();
        std::fill_n(e.received[0], 3 * handed_size(), Real(0));
        const auto state = [&](int row) -> const Real* {
            return row < rows() ? sweep[std::size_t(row)].state : nullptr;
        };
        for (int begin = 0, taken = 0; begin < rows(); begin += rows_at_a_time) {
            const int end = std::min(begin + rows_at_a_time, rows()),
                      inner = std::clamp(rows() - 2, begin, end);
            edge_.rows(e, begin, inner);
            for (int r = inner; r < end; ++r) edge_.last_row(e, r, {state(r), state(r + 1), nullptr});
            if (end == rows()) kernels().edge_finish(e);
            for (; taken < (end == rows() ? end : end - 1); ++taken) {
                double* const row = a + std::ptrdiff_t(taken) * 3 * columns();
                double* const to = layout_.in_one_strip() ? row : window.data();
                take(sweep[std::size_t(taken)].work, 0,
                     {layout_.window, layout_.lanes, layout_.vectors, acceleration_place_.data()}, {}, to);
                if (to != row) layout_.copy_own(strip, to, row);
            }
        }
    }
}

template class StateEngine<float, TransposedLayout>;
template class StateEngine<double, TransposedLayout>;
template class EdgeEngine<float>;
template class EdgeEngine<double>;

}  // namespace clothsim
