// The pass of offset "cell" over a step: kernels/contact/cell_impl.hpp has its law.
//
//   1. The points that may touch a sphere, and the rows that hold such points.
//   2. rho of their cells before the step, unless the step before has left it.
//   3. The response of each point at sqrt(R^2 + rho^2), as for any other offset.
//   4. rho of the cells now. Points that lie deeper than it lets them are moved outwards; again, until none
//   is. A move
//      of d changes rho by at most d and a distance by rho / sqrt(R^2 + rho^2) of that: the rounds contract.
//
// Each phase reads only what the phase before has written, so any number of threads gives the same bits.
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
        : kernels_(kernels.cells<Real>()), strict_(strict), lanes_(lanes) {
        const std::size_t vectors = std::size_t(geometry.rows) * std::size_t(geometry.vectors);
        const int cell_rows = std::max(cloth.rows - 1, 1), cell_columns = std::max(cloth.columns - 1, 1);
        cells_.assign(vectors, 0);
        for (int r = 0; r < cell_rows; ++r)
            for (int j = 0; j < geometry.vectors; ++j)
                for (int l = 0; l < lanes; ++l)
                    cells_[std::size_t(r * geometry.vectors + j)] |=
                        std::uint64_t(layout.column(j, l, lanes) < cell_columns) << l;
        cell_radii2_.assign((vectors + 1) * std::size_t(lanes), Real(0));
        point_radii2_.assign(vectors * std::size_t(lanes), Real(0));
        near_.assign(vectors, 0);
        for (std::vector<std::uint8_t>* const rows : {&near_rows_, &raised_, &capped_, &known_, &wanted_})
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
        a_.near_rows = near_rows_.data();
        a_.raised_rows = raised_.data();
        a_.capped_rows = capped_.data();
    }
    CellPass(const CellPass&) = delete;

    // The state before the next step is not the one after the last.
    void forget() { std::fill(known_.begin(), known_.end(), false); }

    // Parts 1 to 3; false: no point is near. `each(work)` runs work(begin, end) for all rows in parts.
    template <class Each>
    bool respond(const ContactArguments<Real>& contact, const Each& each) {
        a_.contact = contact;
        const int rows = contact.geometry.rows;
        each([&](int begin, int end) { kernels_.near(a_, begin, end); });
        if (!any(near_rows_)) {
            forget();
            return false;
        }
        for (int r = 0; r < rows; ++r)
            wanted_[std::size_t(r)] =
                near_rows_[std::size_t(r)] || (r + 1 < rows && near_rows_[std::size_t(r + 1)]);
        find_radii(contact.before, each, [&](std::size_t r) { return wanted_[r] && !known_[r]; });
        each([&](int begin, int end) {
            (strict_ ? kernels_.respond_strict : kernels_.respond)(a_, begin, end);
        });
        return true;
    }
    // Part 4 for one sphere: a round; whether a point was moved.
    template <class Each>
    bool raise(const Each& each) {
        each([&](int begin, int end) { kernels_.raise(a_, begin, end); });
        return any(raised_);
    }
    template <class Each>
    void find_radii_now(const Each& each) {
        find_radii(a_.contact.state, each, [&](std::size_t r) { return wanted_[r]; });
        known_ = wanted_;
    }

    bool near(int row) const { return near_rows_[std::size_t(row)]; }
    std::uint64_t near_lanes(std::size_t index) const { return near_[index]; }
    bool any_capped() const { return any(capped_); }
    // rho^2 of a point before the step, and with the cells as they are now.
    double radius2_before(std::size_t index, int lane) const {
        return double(point_radii2_[index * std::size_t(lanes_) + std::size_t(lane)]);
    }
    double radius2_now(const Cloth& cloth, int row, int column) const {
        double most = 0;
        for (int r = std::max(row - 1, 0); r <= std::min(row, std::max(cloth.rows - 2, 0)); ++r)
            for (int c = std::max(column - 1, 0); c <= std::min(column, std::max(cloth.columns - 2, 0)); ++c)
                most = std::max(most, double(a_.cell_radii2[place(r, c)]));
        return most;
    }

private:
    static bool any(const std::vector<std::uint8_t>& rows) {
        return std::any_of(rows.begin(), rows.end(), [](std::uint8_t row) { return row != 0; });
    }
    std::ptrdiff_t place(int row, int column) const {
        const int vectors = a_.contact.geometry.vectors;
        const int vector = a_.transposed ? column % vectors : column / lanes_,
                  lane = a_.transposed ? column / vectors : column % lanes_;
        return (std::ptrdiff_t(row) * vectors + vector) * lanes_ + lane;
    }
    // Of the rows that are asked for, many at a time.
    template <class Each, class Asked>
    void find_radii(const Real* state, const Each& each, const Asked& asked) {
        const int cell_rows = int(near_rows_.size()) - (a_.below != 0);
        each([&](int begin, int end) {
            end = std::min(end, cell_rows);
            for (int r = begin; r < end;) {
                int last = r;
                while (last < end && asked(std::size_t(last))) ++last;
                if (last > r) kernels_.radii(a_, state, r, last);
                r = std::max(last, r + 1);
            }
        });
    }

    const CellKernels<Real>& kernels_;
    bool strict_;
    int lanes_;
    CellArguments<Real> a_{};
    std::vector<std::uint64_t> cells_, near_;
    AlignedVector<Real> cell_radii2_, point_radii2_;
    // Rows: with points near a sphere, moved outwards, capped; rows of cells whose rho is known, needed.
    std::vector<std::uint8_t> near_rows_, raised_, capped_, known_, wanted_;
};

}  // namespace clothsim
