// A tile of a picture: nearest surface, colours and pixels of some thousand samples, whose buffers stay in a
// core's cache.
#pragma once

#include <cstdint>
#include <vector>

#include "picture/disc.hpp"
#include "picture/frame.hpp"
#include "picture/shadow.hpp"
#include "picture/visibility.hpp"

namespace clothsim::picture {

// Pixels of a tile, along and down. With 24 bytes for each of four samples a pixel, 48 kB stay in a
// second-level cache. For the picture of 640 x 520, half of both takes 4 % longer. Twice takes 2 % less, with
// a quarter of the parts for threads.
inline constexpr int tile_width = 32, tile_height = 16;

class Tile {
public:
    Tile(const Picture& picture, const Bins& bins, const Shadow& shadow);

    // Draw the tile of that number into the picture's pixels. Whether it has come to its end.
    bool draw(int number, Poll& poll, std::uint8_t* pixels);

private:
    void paint_row(int row);
    void gather(const Facet& facet, int row, int first, int last);
    void paint_ball(const Ball& ball, const Disc& disc);
    void paint_ground();
    void store(std::uint8_t* pixels) const;
    Triple weights(const Facet& facet, int column, int row) const;
    double depth_below(const Ball& ball, const Disc& disc, int column, int row) const;
    std::size_t at(int column, int row) const { return nearest_.at(box_, column, row); }

    const Picture& picture_;
    const Bins& bins_;
    const Shadow& shadow_;
    const bool perspective_;
    std::vector<Disc> discs_;  // of the balls
    Nearest nearest_;
    Box box_;
    std::vector<float> color_[3];
    // Of one row of samples: the sheet there, and the light on it.
    std::vector<double> normal_[3], base_[3], to_eye_[3], lit_, grid_, light_, front_;
};

}  // namespace clothsim::picture
