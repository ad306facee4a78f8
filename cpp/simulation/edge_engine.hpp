// The engine of the "edge" kernel: row-lifted records, one band of rows a thread.
#pragma once

#include <atomic>
#include <memory>

#include "simulation/state_engine.hpp"

namespace clothsim {

// The layout that cpp/kernels/edge_impl.hpp draws: a record per row, column l m + k in vector k, lane l.
struct LiftedLayout {
    int rows, lanes, vectors;
    std::ptrdiff_t plane, record;

    LiftedLayout(const Cloth& cloth, int lanes, bool compensated)
        : rows(cloth.rows),
          lanes(lanes),
          vectors(std::max(2, (cloth.columns + lanes - 1) / lanes)),
          plane(std::ptrdiff_t(vectors) * lanes),
          record((compensated ? RowPlanes::count_compensated : RowPlanes::count) * plane) {}
    std::ptrdiff_t in_plane(int column) const { return column % vectors * lanes + column / vectors; }
    std::ptrdiff_t at(int row, int column, int k = 0) const { return row * record + k * plane + in_plane(column); }
    std::ptrdiff_t compensation() const { return RowPlanes::compensation * plane; }
    template <class Visit>
    void for_each_run(bool compensated, Visit visit) const {
        for (int r = 0; r < rows; ++r) {
            visit(r * record, 6 * plane);
            if (compensated) visit(r * record + compensation(), 6 * plane);
        }
    }
};

template <class Real>
class EdgeEngine final : public StateEngine<Real, LiftedLayout> {
public:
    explicit EdgeEngine(const Plan& plan);
    ~EdgeEngine() override;
    void advance(std::int64_t steps, const Clock& clock, int threads) override;
    void accelerations(double* a, int threads) override;

private:
    using Base = StateEngine<Real, LiftedLayout>;
    using Base::columns, Base::layout_, Base::memory_, Base::plan_, Base::rows;
    struct Band;

    void build_coefficients();
    EdgeArguments<Real> arguments(Band& band, double dt);
    void form_bands(int team);
    void run_band(int index, std::int64_t steps, const Clock& clock);
    Real* row_planes(int row, int first_plane) {
        return memory_.data() + row * layout_.record + first_plane * layout_.plane;
    }

    EdgeRowsKernel<Real> rows_kernel_;
    EdgeHaloKernel<Real> halo_kernel_;
    AlignedVector<Real> coefficients_, inverse_mass_, free_;
    std::vector<std::uint8_t> coefficient_class_, row_has_fixed_;
    std::vector<std::unique_ptr<Band>> bands_;
};

}  // namespace clothsim
