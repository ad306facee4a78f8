// The engine of the "gather" kernel: padded structure of arrays, one tile a row of shader groups.
#pragma once

#include "engines/state_engine.hpp"

namespace clothsim {

// Planes of rows with padding before and behind, wide enough for a vector and two neighbours.
struct PaddedLayout {
    std::ptrdiff_t stride, origin, plane;
    int rows, columns;

    explicit PaddedLayout(const Cloth& cloth)
        : stride(round_up(cloth.columns, group_size) + group_size),
          origin(group_size),
          plane(origin + cloth.rows * stride + group_size),
          rows(cloth.rows),
          columns(cloth.columns) {}
    std::ptrdiff_t at(int row, int column, int k = 0) const {
        return origin + row * stride + column + k * plane;
    }
    std::ptrdiff_t in_row(int column) const { return column; }
    std::ptrdiff_t component() const { return plane; }
    std::ptrdiff_t compensation() const { return 6 * plane; }
    std::ptrdiff_t first() const { return origin; }
    Spans state_spans() const { return {1, 6 * plane - origin, 0}; }
    VectorGeometry geometry(int lanes) const {
        return {stride, lanes, plane, rows, (columns + lanes - 1) / lanes};
    }
    RowShape row_shape() const { return {columns, 1, columns, 1, plane}; }
    int column(int vector, int lane, int lanes) const { return vector * lanes + lane; }
    static constexpr bool is_transposed = false;
};

template <class Real>
class GatherEngine : public StateEngine<Real, PaddedLayout> {
public:
    explicit GatherEngine(const Plan& plan);
    void advance(std::int64_t steps, const Clock& clock, int threads) override;
    void accelerations(double t, double* a) override;

protected:  // for cpp/integrators; see EdgeEngine
    using Base = StateEngine<Real, PaddedLayout>;
    using Base::columns, Base::kernels, Base::layout_, Base::memory_, Base::plan_, Base::rows;

    FieldLayout field() const;
    void begin_sweep(const Real* state, Real* acceleration, FieldBand<Real>& band);
    int sweep_rows(int begin, int end, FieldBand<Real>& band);
    double newton_in_sums() const { return coefficient_scale(plan_); }

private:
    void build_coefficients();
    void make_room_for_forces() override;
    void put_forces(const Points& forces, int begin, int end) override;
    GatherArguments<Real> arguments(Stage stage, double dt);

    ThreadGrid grid_;
    GatherKernel<Real> kernel_;
    AlignedVector<Real> inverse_mass_, forces_, free_;
    SpringCoefficients<Real> spring_[spring_kind_count];
    std::vector<LanesWithNeighbour> lanes_;
    std::vector<std::uint8_t> row_has_fixed_;
    AlignedVector<Real> stage_a_, stage_b_;                      // six planes each
    AlignedVector<Real> first_acceleration_, acceleration_sum_;  // three planes each
};

extern template class StateEngine<float, PaddedLayout>;
extern template class StateEngine<double, PaddedLayout>;

}  // namespace clothsim
