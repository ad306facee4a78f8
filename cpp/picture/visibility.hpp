// Which triangle of the sheet is nearest at each sample. Sorting of whole triangles cannot show contact:
// cloth and sphere lie tenths of a millimetre apart, the triangles are a hundred times larger. Each sample
// therefore keeps its nearest point.
#pragma once

#include <cstdint>
#include <vector>

#include "memory/poll.hpp"
#include "picture/frame.hpp"

namespace clothsim::picture {

// Samples [left, right) x [top, bottom) of a picture.
struct Box {
    int left = 0, top = 0, right = 0, bottom = 0;
    bool empty() const { return left >= right || top >= bottom; }
};
Box intersection(const Box& a, const Box& b);

// A triangle in the picture. The weights of its second and third corner are linear in the distance from the
// first.
struct Facet {
    std::array<std::int64_t, 3> corners;
    Box box;
    double x, y;  // from the first corner to the first sample of the box
    double b_x, b_y, c_x, c_y;
    double nearness, b_nearness, c_nearness;  // of the first corner, and of the others less that

    // Weights of the corners b and c.
    double b(double dx, double dy) const { return b_x * dx + b_y * dy; }
    double c(double dx, double dy) const { return c_x * dx + c_y * dy; }
};
// Box of samples that a triangle may cover, empty where a corner is behind the eye.
Box box_of(const Sheet& sheet, std::int64_t triangle, int columns, int rows);
Facet facet_of(const Sheet& sheet, std::int64_t triangle, const Box& box);

// Triangles that may cover samples of each tile, in ascending order.
class Bins {
public:
    Bins(const Sheet& sheet, int columns, int rows, int tile_columns, int tile_rows, Poll& poll);

    int count() const { return across_ * down_; }
    Box tile(int number) const;
    Box box(const Sheet& sheet, std::int64_t triangle) const {
        return box_of(sheet, triangle, columns_, rows_);
    }
    std::int64_t first(int tile) const { return first_[std::size_t(tile)]; }
    std::int64_t most() const;
    std::int64_t operator[](std::int64_t k) const { return triangles_[std::size_t(k)]; }

private:
    template <class Visit>
    void each_tile(const Sheet& sheet, Poll& poll, Visit visit) const;

    int columns_, rows_, tile_columns_, tile_rows_, across_, down_;
    std::vector<std::int64_t> first_, triangles_;
};

// The nearest facets of a tile's samples. The buffers are row by row, as wide as the tile may be.
struct Nearest {
    int width;                  // samples from a row to the next
    std::vector<Facet> facets;  // of this tile
    std::vector<double> nearness;
    std::vector<double> facet;  // number in `facets`, or -1; a double, so that one loop compares and selects

    Nearest(int columns, int rows, std::int64_t most);
    // Whether it has come to its end.
    bool find(const Sheet& sheet, const Bins& bins, int tile, Poll& poll);
    std::size_t at(const Box& tile, int column, int row) const {
        return std::size_t(row - tile.top) * std::size_t(width) + std::size_t(column - tile.left);
    }
};

}  // namespace clothsim::picture
