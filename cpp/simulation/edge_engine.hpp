// The engine of the "edge" kernel: row-lifted rows, one band of them a thread.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <vector>

#include "dynamics/field.hpp"
#include "simulation/state_engine.hpp"

namespace clothsim {

// The layout that cpp/kernels/edge_impl.hpp draws: column l m + k is lane l of vector k; a row is its vectors'
// records one after the other.
//
// Long rows are cut into strips that overlap, each laid out like a cloth of its own and without padding, one after the
// other. A column of an overlap belongs to the nearer strip; the other one has a copy of it (its halo).
struct LiftedLayout {
    // A step lets the end of a strip be felt two columns further in with each of its four stages.
    static constexpr int halo = 8;

    int rows, columns, lanes, strips, vectors;
    std::ptrdiff_t stride;  // elements from vector to vector

    LiftedLayout(const Cloth& cloth, int lanes, bool compensated, int strips = 1)
        : rows(cloth.rows),
          columns(cloth.columns),
          lanes(lanes),
          strips(strips),
          vectors(std::max(2, (columns + 2 * halo * (strips - 1) + strips * lanes - 1) / (strips * lanes))),
          stride((compensated ? StateRecord::count_compensated : StateRecord::count) * lanes),
          place_(std::size_t(columns)) {
        for (int strip = 0; strip < strips; ++strip)
            for (int c = owned_begin(strip); c < owned_begin(strip + 1); ++c) {
                const int local = c - first_column(strip);
                place_[std::size_t(c)] = strip * rows * row_size() + local % vectors * stride + local / vectors;
            }
    }
    int first_column(int strip) const {
        return strips == 1 ? 0 : int(std::int64_t(strip) * (columns - width()) / (strips - 1));
    }
    // Of the strip after the last one: the number of columns.
    int owned_begin(int strip) const {
        return strip == 0 ? 0 : strip == strips ? columns : (first_column(strip) + first_column(strip - 1) + int(width())) / 2;
    }
    int strip_columns() const { return strips == 1 ? columns : int(width()); }
    std::ptrdiff_t row_size() const { return vectors * stride; }  // of a strip
    std::ptrdiff_t size() const { return std::ptrdiff_t(strips) * rows * row_size(); }
    std::ptrdiff_t at(int row, int column, int k = 0) const {
        return row * row_size() + place_[std::size_t(column)] + k * lanes;
    }
    std::ptrdiff_t compensation() const { return StateRecord::compensation * lanes; }
    std::ptrdiff_t first() const { return 0; }
    VectorGeometry geometry(int) const { return {row_size(), stride, lanes, compensation(), rows, vectors}; }
    int column(int vector, int lane, int) const { return lane * vectors + vector; }
    // Where a point of a strip stands among values of which there is one a point.
    std::ptrdiff_t in_row(int column) const { return column % vectors * lanes + column / vectors; }
    std::ptrdiff_t width() const { return vectors * lanes; }

private:
    std::vector<std::ptrdiff_t> place_;  // by column, of the first row
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
    // Accelerations of rows [begin, end) at a state in the engine's layout. A band has at least two rows before it or
    // begins the cloth.
    void evaluate(const Real* state, Real* acceleration, int begin, int end, FieldScratch<Real>& scratch);
    // The collision pass over some rows; whether any point was found inside.
    bool collide_rows(int begin, int end, const std::vector<Contact>& contacts);

private:
    struct Band;

    void build_coefficients();
    Real stiffness_at_rest(const Neighbour& neighbour, Real stiffness, Real tension) const;
    std::vector<std::unique_ptr<Band>>& bands(int team);
    void run_bands(int team, int thread, std::int64_t steps, const Clock& clock);
    void run_step(Band& band, std::int64_t number, double t);
    EdgeArguments<Real> arguments(Band& band, Stage stage, double dt);
    EdgeArguments<Real> arguments(Stage stage, double dt, Real* scratch) const;
    // The columns that a strip's row has in common with the next strip (seam = strip) and the one before, on their way
    // from the strip that owns them and to the one that does not.
    void to_seams(const Real* state, int strip, int row, int parity);
    void from_seams(Real* state, int strip, int row, int parity) const;
    void know_seams(int begin, int end, std::int64_t step);
    std::ptrdiff_t seam(int strip, int row, int parity) const {
        return ((std::ptrdiff_t(parity) * (layout_.strips - 1) + strip) * rows() + row) * seam_size_;
    }
    // `row` counts those of all strips.
    bool is_special(std::ptrdiff_t row) const {
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
    AlignedVector<Real> seams_;  // [parity of the step][seam][row][column][x, v]
    std::ptrdiff_t seam_size_ = 0;
    int parity_ = 0;  // of the seams that hold the state in memory
    std::map<int, std::vector<std::unique_ptr<Band>>> bands_;  // by the size of the team
};

}  // namespace clothsim
