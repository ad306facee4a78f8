// The engine of the "edge" kernel: lane-transposed rows, one band of them a thread.
#pragma once

#include <map>
#include <memory>

#include "engines/state_engine.hpp"
#include "kernels/kernel_table.hpp"
#include "memory/strip_halos.hpp"
#include "memory/transposed_layout.hpp"

namespace clothsim {

template <class Real>
class EdgeEngine : public StateEngine<Real, TransposedLayout> {
public:
    // `in_strips`: a cloth that does not fit into cache may be cut.
    explicit EdgeEngine(const Plan& plan, bool in_strips = false);
    ~EdgeEngine() override;
    void advance(std::int64_t steps, const Clock& clock, int threads) override;
    void accelerations(double t, double* a) override;

protected:  // for cpp/integrators
    using Base = StateEngine<Real, TransposedLayout>;
    using Base::columns, Base::kernels, Base::layout_, Base::memory_, Base::plan_, Base::rows;

    FieldLayout field() const;
    // These compute accelerations at a state in the engine's layout, of the rows of a band one
    // after the other. `begin_sweep` needs the two rows before the band. Then come calls of
    // `sweep_rows` from 0 on. It reads two rows more and returns how many of the rows are done. The
    // state of a row that is done is not read again.
    void begin_sweep(const Real* state, Real* acceleration, FieldBand<Real>& band, int strip = 0);
    // Returns what a force of 1 N is in the sums of the kernel.
    double newton_in_sums() const { return coefficient_scale(plan_) / unit_; }
    int sweep_rows(int begin, int end, FieldBand<Real>& band);

private:
    struct Band;

    void build_coefficients();
    void make_room_for_forces() override;
    double unit_of_stored_forces() const override { return unit_; }
    void put_forces(const Points& forces, int begin, int end) override;
    // Returns the bands of a team of threads, strip after strip.
    std::vector<std::unique_ptr<Band>>& bands(int team);
    void run_bands(int team, int thread, std::int64_t steps, const Clock& clock);
    void step_band(Band& band);
    // These are the parts of a step's stage s = 0..3.
    void begin_stage(Band& band, int s);
    // Places the obstacles at the times of the stages of the band's next step.
    void place_contacts(Band& band);
    void run_rows(Band& band, int s, int begin, int end);
    void run_last_rows(Band& band, int s, int begin, int end);
    // Puts driven pins to their places at the end of stage s, in rows [begin, end) of the band.
    void end_pins(Band& band, int s, int begin, int end);
    // Returns whether a stage hands rows on: with strips the next step's state is sent when their
    // halos are full.
    bool hands_on(int s) const { return s < 3 || layout_.strips == 1; }
    // Takes rows [begin, end) through a stage, by one of the two kernels.
    void sum_rows(EdgeRowsKernel<Real> kernel, EdgeArguments<Real>& e, int begin, int end) const {
        if (e.contacts.count > 0 && begin < end)
            e.forces = kernels().edge_near(e, begin, end) ? kernels().edge_forces : nullptr;
        kernel(e, begin, end);
    }
    EdgeArguments<Real> arguments(Stage stage, double dt, Real* scratch) const;
    // Returns the places of a strip's row, whose state and work lie there.
    EdgeRowPointers<Real> row_pointers(Real* state, Real* work, int row, int strip) const {
        const std::ptrdiff_t index = std::ptrdiff_t(strip) * rows() + row;
        return {
            state,
            work,
            inverse_mass_.empty() ? nullptr : inverse_mass_.data() + index * layout_.width(),
            forces_.empty() ? nullptr : forces_.data() + 3 * index * layout_.width(),
            row_has_fixed_[std::size_t(index)] ? free_.data() + index * layout_.width() : nullptr,
            row};
    }
    // Elements that a row passes on: a force for each point and one vector more. A stage has three
    // of it, and the pending forces.
    std::ptrdiff_t handed_size() const { return 3 * (layout_.width() + layout_.lanes); }
    std::ptrdiff_t scratch_size() const { return 4 * handed_size(); }

    EdgeRowsKernel<Real> edge_rows_;  // with two rows more behind
    AlignedVector<Real> coefficients_, reach_, inverse_mass_, forces_, free_;
    std::vector<std::uint8_t> coefficient_class_, row_has_fixed_;
    double unit_ = 1;  // of the accelerations the kernel sums
    bool damped_alike_ = false;
    int whole_vectors_ = 0;
    std::map<int, std::vector<std::unique_ptr<Band>>> bands_;  // by the size of the team
    StripHalos<Real> halos_;
    std::int64_t step_ = 0;  // of the state in memory
};

extern template class StateEngine<float, TransposedLayout>;
extern template class StateEngine<double, TransposedLayout>;

}  // namespace clothsim
