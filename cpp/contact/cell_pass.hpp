// The pass of offset "cell" over a step: kernels/contact/cell_impl.hpp has its law.
//
//   1. The points that may touch a sphere respond at sqrt(R^2 + rho^2), as for any other offset. rho is that
//      of their cells before the step. Rows where the step before has not left it wait until it is found.
//   2. rho of the cells now. Points that lie deeper than it lets them are moved outwards; again, until none
//      is. A move of d changes rho by at most d and a distance by rho / sqrt(R^2 + rho^2) of that: the rounds
//      contract. Later rounds visit the rows beside points that were moved.
//
// A phase reads what the phase before has written, or what its own rows wrote before. So any number of
// threads gives the same bits.
#pragma once

#include <algorithm>
#include <vector>

#include "kernels/contact/contact_kernels.hpp"
#include "memory/aligned_vector.hpp"
#include "model/cloth.hpp"

namespace clothsim {

template <class Real>
class CellPass {
public:
    template <class Layout>
    CellPass(const Cloth& cloth, const Layout& layout, const VectorGeometry& geometry, int lanes,
             const ContactKernels& kernels, bool strict)
        : kernels_(kernels.cells<Real>(strict)),
          lanes_(lanes),
          columns_(cloth.columns),
          cell_rows_(std::max(cloth.rows - 1, 1)) {
        const std::size_t vectors = std::size_t(geometry.rows) * std::size_t(geometry.vectors);
        const int cell_columns = std::max(cloth.columns - 1, 1);
        cells_.assign(vectors, 0);
        for (int r = 0; r < cell_rows_; ++r)
            for (int j = 0; j < geometry.vectors; ++j)
                for (int l = 0; l < lanes; ++l)
                    cells_[std::size_t(r * geometry.vectors + j)] |=
                        std::uint64_t(layout.column(j, l, lanes) < cell_columns) << l;
        cell_radii2_.assign((vectors + 1) * std::size_t(lanes), Real(0));
        point_radii2_.assign(vectors * std::size_t(lanes), Real(0));
        near_.assign(vectors, 0);
        raisable_.assign(vectors, 0);
        for (std::vector<std::uint8_t>* const rows : {&marks_, &known_, &wanted_})
            rows->assign(std::size_t(geometry.rows), 0);
        const auto right = layout.right();
        a_.right = cloth.columns > 1 ? right[0] : 0;
        a_.right_of_last = cloth.columns > 1 ? right[1] : 0;
        a_.below = cloth.rows > 1 ? geometry.row : 0;
        a_.transposed = Layout::is_transposed;
        a_.cells = cells_.data();
        a_.cell_radii2 = cell_radii2_.data() + lanes;
        a_.point_radii2 = point_radii2_.data();
        a_.near = near_.data();
        a_.raisable = raisable_.data();
        a_.marks = marks_.data();
        a_.known = known_.data();
        a_.wanted = wanted_.data();
        forget();
    }
    CellPass(const CellPass&) = delete;

    // The state before the next step is not the one after the last.
    void forget() {
        std::fill(known_.begin(), known_.end(), false);
        if (cell_rows_ < int(known_.size())) known_.back() = true;  // no cells
    }

    // Part 1; false: no point is near. `each(work)` runs work(begin, end) for all rows in parts, or in one
    // (alone).
    template <class Each>
    bool respond(const ContactArguments<Real>& contact, const Each& each, bool alone) {
        a_.contact = contact;
        a_.only_waiting = false;
        alone_ = alone;
        raised_rows_ = 0;
        const auto run = [&](int begin, int end) { kernels_.respond(a_, begin, end); };
        // Bounces in the air are left to the pass, which needs the neighbours before any is moved outwards.
        if (alone && contact.sphere_count == 1 && contact.spheres[0].restitution == 0)
            raised_rows_ = kernels_.stream(a_);
        else each(run);
        const std::uint8_t all = marks();
        if (all & CellMarks::waits) {
            want(CellMarks::waits);
            for (std::size_t r = 0; r < known_.size(); ++r) wanted_[r] = wanted_[r] && !known_[r];
            each([&](int begin, int end) { kernels_.radii(a_, contact.before, begin, end); });
            for (std::size_t r = 0; r < known_.size(); ++r) known_[r] |= wanted_[r];
            a_.only_waiting = true;
            each(run);
        }
        want(CellMarks::near);
        forget();
        for (std::size_t r = 0; r < known_.size(); ++r) known_[r] |= wanted_[r];
        a_.first_round = true;
        return all != 0;
    }
    // Part 2 for one sphere: a round; whether a point was moved. Rows are copied for the next step.
    template <class Each>
    bool raise(const Each& each) {
        a_.found = !alone_;
        if (!alone_) find_radii(each);
        if (!a_.first_round) raised_rows_ = 0;
        if (raised_rows_ < int(marks_.size()))
            each([&](int begin, int end) { kernels_.raise(a_, std::max(begin, raised_rows_), end); });
        a_.first_round = false;
        if (!(marks() & CellMarks::raised)) return false;
        want(CellMarks::raised);
        return true;
    }
    // rho of the wanted cells as they are now.
    template <class Each>
    void find_radii(const Each& each) {
        each([&](int begin, int end) { kernels_.radii(a_, a_.contact.state, begin, end); });
    }

    // Of all rows together, and of one (CellMarks).
    std::uint8_t marks() const {
        std::uint8_t all = 0;
        for (const std::uint8_t row : marks_) all |= row;
        return all;
    }
    std::uint8_t marks(int row) const { return marks_[std::size_t(row)]; }
    std::uint64_t near_lanes(std::size_t index) const { return near_[index]; }
    // rho^2 of a near point before the step, and with the cells as they are now.
    double radius2_before(int i) const {
        return double(point_radii2_[std::size_t(place(i / columns_, i % columns_))]);
    }
    double radius2_now(int i) const {
        double most = 0;
        const int row = i / columns_, column = i % columns_;
        for (int r = std::max(row - 1, 0); r <= std::min(row, cell_rows_ - 1); ++r)
            for (int c = std::max(column - 1, 0); c <= std::min(column, std::max(columns_ - 2, 0)); ++c)
                most = std::max(most, double(a_.cell_radii2[place(r, c)]));
        return most;
    }

private:
    // The cells beside points of the rows with this mark.
    void want(std::uint8_t mark) {
        for (int r = 0; r < cell_rows_; ++r)
            wanted_[std::size_t(r)] =
                ((marks_[std::size_t(r)] | marks_[std::min(std::size_t(r) + 1, marks_.size() - 1)]) & mark) !=
                0;
    }
    std::ptrdiff_t place(int row, int column) const {
        const int vectors = a_.contact.geometry.vectors;
        const int vector = a_.transposed ? column % vectors : column / lanes_,
                  lane = a_.transposed ? column / vectors : column % lanes_;
        return (std::ptrdiff_t(row) * vectors + vector) * lanes_ + lane;
    }

    const typename CellKernels<Real>::Passes& kernels_;
    int lanes_, columns_, cell_rows_;
    int raised_rows_ = 0;  // that the stream has done in this step
    bool alone_ = true;
    CellArguments<Real> a_{};
    std::vector<std::uint64_t> cells_, near_, raisable_;
    AlignedVector<Real> cell_radii2_, point_radii2_;
    std::vector<std::uint8_t> marks_;  // rows of points
    std::vector<std::uint8_t> known_, wanted_;  // rows of cells: rho is that before the step; is needed
};

}  // namespace clothsim
