// Halo columns of the strips of a cloth: the state of the columns around each border, after the
// newest step and after the step before. A strip's neighbours may be a step ahead of it.
#pragma once

#include "lanes/aligned_vector.hpp"
#include "memory/row_band.hpp"
#include "memory/transposed_layout.hpp"

namespace clothsim {

template <class Real>
class StripHalos {
public:
    explicit StripHalos(const TransposedLayout& layout) : lanes_(layout.lanes) {
        for (int s = 1; s < layout.strips; ++s) {
            const int begin = layout.first_column_of(s);
            const int end = layout.first_column_of(s - 1) + layout.window;
            Border border{layout.first_own_column_of(s) - begin, {}, {}};
            for (int c = begin; c < end; ++c) {
                border.places[0].push_back(layout.in_record(c - layout.first_column_of(s - 1)));
                border.places[1].push_back(layout.in_record(c - begin));
            }
            for (auto& values : border.values)
                values.assign(std::size_t(layout.rows) * 6 * border.places[0].size(), Real(0));
            halos_.push_back(std::move(border));
        }
    }
    // Puts down the strip's own columns of a row, whose `state` is that after the step of number
    // `step`.
    void give(int strip, int row, const Real* state, std::int64_t step) {
        visit(strip, row, step, true, [&](Columns columns) {
            for (int i = 0; i < columns.count; ++i)
                for (int k = 0; k < 6; ++k)
                    columns.values[6 * i + k] = state[columns.places[i] + k * lanes_];
        });
    }
    // Fills the columns of the strip's halo in a row.
    void take(int strip, int row, Real* state, std::int64_t step) {
        visit(strip, row, step, false, [&](Columns columns) {
            for (int i = 0; i < columns.count; ++i)
                for (int k = 0; k < 6; ++k)
                    state[columns.places[i] + k * lanes_] = columns.values[6 * i + k];
        });
    }
    // Prefetches the columns that the two read, as they come from memory.
    void claim(int strip, int row, std::int64_t step) {
        visit(strip, row, step, true, [](Columns columns) {
            for_each_line(columns.values, 6 * columns.count, prefetch_to_write);
        });
    }
    void fetch(int strip, int row, std::int64_t step) {
        visit(strip, row, step, false, [](Columns columns) {
            for_each_line(columns.values, 6 * columns.count, prefetch_to_read);
        });
    }

private:
    struct Border {
        int middle;  // how many of the columns are the first strip's own
        // Places of the columns in a row of the strip before the border and of the one behind it.
        std::vector<std::ptrdiff_t> places[2];
        AlignedVector<Real> values[2];  // (row, column, 6), by the parity of the step
    };
    // Columns that one of two strips owns.
    struct Columns {
        const std::ptrdiff_t* places;  // in a row of the strip that is visited
        Real* values;
        int count;
    };

    template <class Visit>
    void visit(int strip, int row, std::int64_t step, bool own, const Visit& visit) {
        // The first border is that before the strip, which is the second at it; the other is behind
        // it.
        for (int side = 0; side < 2; ++side) {
            const int index = strip - 1 + side;
            if (index < 0 || index >= int(halos_.size())) continue;
            Border& border = halos_[std::size_t(index)];
            const auto& places = border.places[1 - side];
            const int count = int(places.size());
            const bool first_half = (side == 1) == own;
            const int begin = first_half ? 0 : border.middle;
            const int end = first_half ? border.middle : count;
            visit({places.data() + begin,
                   border.values[step & 1].data() + 6 * (std::ptrdiff_t(row) * count + begin),
                   end - begin});
        }
    }

    int lanes_;
    std::vector<Border> halos_;
};

}  // namespace clothsim
