// The engine of the "edge" kernel: row-lifted rows, one band of them a thread.
#pragma once

#include <atomic>
#include <map>
#include <memory>

#include "dynamics/field.hpp"
#include "simulation/state_engine.hpp"

namespace clothsim {

// The layout that cpp/kernels/edge_impl.hpp draws: column l m + k is lane l of vector k; a row is its vectors'
// records one after the other.
struct LiftedLayout {
    int rows, columns, lanes, vectors;
    std::ptrdiff_t stride;  // elements from vector to vector
    std::vector<std::ptrdiff_t> place;  // of (x, y, z) of each vector in a row

    LiftedLayout(const Cloth& cloth, int lanes, bool compensated)
        : rows(cloth.rows),
          columns(cloth.columns),
          lanes(lanes),
          vectors(std::max(2, (cloth.columns + lanes - 1) / lanes)),
          stride((compensated ? StateRecord::count_compensated : StateRecord::count) * lanes) {
        for (int k = 0; k < vectors; ++k)
            for (int component = 0; component < 3; ++component) place.push_back(k * stride + component * lanes);
    }
    std::ptrdiff_t row_size() const { return vectors * stride; }
    std::ptrdiff_t at(int row, int column, int k = 0) const {
        return row * row_size() + column % vectors * stride + k * lanes + column / vectors;
    }
    std::ptrdiff_t compensation() const { return StateRecord::compensation * lanes; }
    std::ptrdiff_t first() const { return 0; }
    // Where the state stands, without its compensation.
    Blocks state_blocks() const { return {std::ptrdiff_t(rows) * vectors, StateRecord::compensation * lanes, stride}; }
    VectorGeometry geometry(int) const { return {row_size(), stride, lanes, compensation(), rows, vectors}; }
    int column(int vector, int lane, int) const { return lane * vectors + vector; }
    // (x, y, z) of the columns of a row into and out of three components of it.
    template <class Real>
    void put_row(const Real* row, Real* to) const {
        to_lanes(row, to, {columns, lanes, vectors, place.data()});
    }
    template <class Real>
    void take_row(const Real* from, Real* row) const {
        from_lanes(from, row, {columns, lanes, vectors, place.data()});
    }
    // Where a point stands among values of which there is one a point.
    std::ptrdiff_t in_row(int column) const { return column % vectors * lanes + column / vectors; }
    std::ptrdiff_t width() const { return vectors * lanes; }
};

template <class Real>
class EdgeEngine : public StateEngine<Real, LiftedLayout> {
public:
    explicit EdgeEngine(const Plan& plan);
    ~EdgeEngine() override;
    void advance(std::int64_t steps, const Clock& clock, int threads) override;
    void accelerations(double* a, int threads) override;

protected:  // for cpp/dynamics, in edge_evaluate.cpp
    using Base = StateEngine<Real, LiftedLayout>;
    using Base::columns, Base::layout_, Base::memory_, Base::plan_, Base::rows;

    FieldLayout field() const;
    // Accelerations at a state in the engine's layout, of the rows of a band one after the other: `begin_sweep`, for
    // which the two rows before the band have to be there, then `sweep_row` for i = 0, 1, ..., which looks at two rows
    // more and returns how many of the rows are done. The state of a row that is done is not looked at again.
    void begin_sweep(const Real* state, Real* acceleration, const RowBand& band, FieldScratch<Real>& scratch);
    int sweep_row(int i, FieldScratch<Real>& scratch);
    // The collision pass over some rows; whether any point was found inside.
    bool collide_rows(int begin, int end, const std::vector<Contact>& contacts);

private:
    struct Band;

    void build_coefficients();
    Real stiffness_at_rest(const Neighbour& neighbour, Real stiffness, Real tension) const;
    std::vector<std::unique_ptr<Band>>& bands(int team);
    void run_band(Band& band, std::int64_t steps, const Clock& clock);
    EdgeArguments<Real> arguments(Band& band, Stage stage, double dt);
    EdgeArguments<Real> arguments(Stage stage, double dt, Real* scratch) const;
    bool is_special(int row) const {
        return row_has_fixed_[std::size_t(row)] != 0 || !inverse_mass_.empty() || plan_.cloth.point_damping != 0;
    }
    // What a row hands on: a force for each point and one vector more. A stage has three of it, and the pending forces.
    std::ptrdiff_t handed_size() const { return 3 * (layout_.width() + layout_.lanes); }
    std::ptrdiff_t scratch_size() const { return 4 * handed_size(); }

    EdgeStageKernel<Real> stage_kernel_;
    EdgeWavesKernel<Real> waves_kernel_;
    EdgeHaloKernel<Real> halo_kernel_;
    EdgeFinishKernel<Real> finish_kernel_;
    AlignedVector<Real> coefficients_, inverse_mass_, free_;
    std::vector<std::uint8_t> coefficient_class_, row_has_fixed_;
    double force_scale_ = 1;  // what the forces the kernel sums are to be multiplied by
    bool complete_ = false;
    std::map<int, std::vector<std::unique_ptr<Band>>> bands_;  // by the size of the team
};

}  // namespace clothsim
