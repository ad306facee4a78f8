// The layout that cpp/kernels/edge/edge_row.hpp draws: column l m + k is lane l of vector k. A row
// is its vectors' records one after the other; in single the records of their compensation follow.
//
// A wide cloth is cut into strips of columns, each with all its rows laid out like that. A strip's
// window reaches into its neighbours, by at least as many columns as a step can carry news:
//
//     strip 0  |------ own ------|-halo-|
//     strip 1                |-halo-|------ own ------|-halo-|
//
// so that it can take a step by itself; what is in its halo then is wrong, and is brought from the
// neighbours.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "kernels/edge/edge_arguments.hpp"
#include "kernels/row_arguments.hpp"
#include "lanes/aligned_vector.hpp"
#include "memory/row_band.hpp"
#include "model/cloth.hpp"

namespace clothsim {

// A step has four evaluations, each of which reads two columns further.
inline constexpr int halo_columns = 8;

struct TransposedLayout {
    int rows, columns, strips, window, lanes, vectors;
    int parts;  // of a row: the state, and its compensation
    std::ptrdiff_t stride;  // elements from vector to vector
    // The place of each column of the cloth in row 0, in the strip whose own it is.
    std::vector<std::ptrdiff_t> column_place;

    // Lays a cloth out in strips of about `strip_columns` columns; 0: in a single one.
    TransposedLayout(const Cloth& cloth, int lanes, bool compensated, int strip_columns)
        : rows(cloth.rows), columns(cloth.columns), strips(1), window(cloth.columns), lanes(lanes) {
        if (strip_columns > 0 && columns > strip_columns + 2 * halo_columns)
            choose_strip_columns(strip_columns);
        vectors = std::max(2, (window + lanes - 1) / lanes);
        stride = StateRecord::count * lanes;
        parts = compensated ? 2 : 1;
        for (int s = 0; s < strips; ++s)
            for (int c = first_own_column_of(s); c < first_own_column_of(s + 1); ++c)
                column_place.push_back(s * strip_size() + in_record(c - first_column_of(s)));
    }
    // The first returns the first column of a strip's window; the second the first of those that
    // are its own.
    int first_column_of(int strip) const {
        return strips == 1 ? 0 : int(std::int64_t(strip) * (columns - window) / (strips - 1));
    }
    int first_own_column_of(int strip) const {
        if (strip == 0) return 0;
        return strip == strips ? columns
                               : (first_column_of(strip) + first_column_of(strip - 1) + window) / 2;
    }

    std::ptrdiff_t row_size() const { return parts * vectors * stride; }
    std::ptrdiff_t strip_size() const { return rows * row_size(); }
    std::ptrdiff_t size() const { return strips * strip_size(); }
    // Elements from the first column of a row to another, and from a component to the next.
    std::ptrdiff_t in_row(int column) const { return column_place[std::size_t(column)]; }
    std::ptrdiff_t component() const { return lanes; }
    std::ptrdiff_t at(int row, int column, int k = 0) const {
        return row * row_size() + in_row(column) + k * lanes;
    }
    // Returns where the column of a strip's window stands in its row.
    std::ptrdiff_t in_record(int column) const {
        return column % vectors * stride + column / vectors;
    }
    std::ptrdiff_t compensation() const { return vectors * stride; }
    std::ptrdiff_t first() const { return 0; }
    // Returns where the state stands, without its compensation.
    Spans state_spans() const {
        return {std::ptrdiff_t(strips) * rows, vectors * stride, row_size()};
    }
    // The cloth has to be in one strip.
    VectorGeometry geometry(int) const { return {row_size(), stride, lanes, rows, vectors}; }
    int column(int vector, int lane, int) const { return lane * vectors + vector; }
    // The shape of a strip's row; `count` is the vectors of a record.
    RowShape shape(int count) const { return {window, lanes, vectors, count * lanes, lanes}; }
    RowShape row_shape() const { return shape(StateRecord::count); }
    static constexpr bool is_transposed = true;

    // Calls `visit(column, vector, lane)` for each column of a window.
    template <class Visit>
    void for_each_column(Visit visit) const {
        for (int lane = 0, c = 0; lane < lanes; ++lane)
            for (int k = 0; k < vectors && c < window; ++k, ++c) visit(c, k, lane);
    }
    std::ptrdiff_t width() const { return vectors * lanes; }
    bool is_padded() const { return window != width(); }  // rows end within a vector

private:
    void choose_strip_columns(int strip_columns) {
        constexpr int overlap = 2 * halo_columns;
        strips = (columns - overlap + strip_columns - 1) / strip_columns;
        // A window has whole vectors, so that no row has padding.
        const auto is_wide_enough = [&] {
            return (columns - window + strips - 2) / (strips - 1) <= window - overlap;
        };
        for (window = lanes; !is_wide_enough();) window += lanes;
    }
};

}  // namespace clothsim
