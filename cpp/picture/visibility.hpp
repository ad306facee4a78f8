// Which triangle of the sheet is nearest at each sample: between cloth and sphere lie tenths of a
// millimetre, so that sorting of whole triangles cannot show contact.
#pragma once

#include "memory/poll.hpp"
#include "picture/picture.hpp"

namespace clothsim::picture {

// Samples [left, right) x [top, bottom) of a picture.
struct Box {
    int left = 0, top = 0, right = 0, bottom = 0;
};
// The samples of a rectangle within a box.
Box clipped(double left, double top, double right, double bottom, const Box& within);

// A triangle in the picture. The weights of its second and third corner are linear in the distance
// from the first.
struct Facet {
    std::array<std::int64_t, 3> corners;
    bool lower;  // of the two triangles of a cell
    double x, y;  // of the first corner
    double b_x, b_y, c_x, c_y;
    double nearness, b_nearness, c_nearness;  // of the first corner, and of the others less that

    // Weights of the corners b and c.
    double b(double dx, double dy) const { return b_x * dx + b_y * dy; }
    double c(double dx, double dy) const { return c_x * dx + c_y * dy; }
};

// Triangles that may cover samples of each tile, in ascending order.
class Bins {
public:
    Bins(const Sheet& sheet, Box whole, int tile_columns, int tile_rows, Poll& poll);

    int count() const { return across_ * down_; }
    Box tile(int number) const;
    // Samples that a triangle may cover, none where a corner is behind the eye.
    Box box(const Sheet& sheet, std::int64_t triangle) const;

private:
    friend struct Nearest;
    template <class Visit>
    void each_tile(const Sheet& sheet, Poll& poll, Visit visit) const;

    Box whole_;
    int tile_columns_, tile_rows_, across_, down_;
    std::vector<std::int64_t> first_, triangles_;
};

// The nearest facets of a tile's samples. The buffers are row by row, as wide as the tile may be.
struct Nearest {
    int width;  // samples from a row to the next
    std::vector<Facet> facets;  // of this tile
    std::vector<double> nearness;
    // Number in `facets`, or -1; a double, so that one loop compares and selects.
    std::vector<double> facet;

    Nearest(int columns, int rows);
    // Whether it has come to its end.
    bool find(const Sheet& sheet, const Bins& bins, int tile, Poll& poll);
    std::size_t at(const Box& tile, int column, int row) const {
        return std::size_t(row - tile.top) * std::size_t(width) + std::size_t(column - tile.left);
    }
};

}  // namespace clothsim::picture
