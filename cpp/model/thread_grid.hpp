// The compute shader's thread grid: one thread per mass point, groups of 16 x 16 x 1 threads.
//
//   dispatch id (x, y) = group (x, y) * 16 + thread in group (x, y)
//   index              = y * width + x          width = columns, height = rows
//
// A shape that is no multiple of 16 is covered by whole groups; threads outside it do nothing.
// The kernels walk the same grid: SIMD lanes are neighbouring threads of a row, a thread takes
// whole groups.
#pragma once

#include <cstdint>

namespace clothsim {

// A group has so many mass points along and down: 256 threads, as WebGPU guarantees.
inline constexpr int group_size = 16;

struct ThreadGrid {
    int width;
    int height;

    int groups_x() const { return (width + group_size - 1) / group_size; }
    int groups_y() const { return (height + group_size - 1) / group_size; }
    int groups() const { return groups_x() * groups_y(); }
};

struct ThreadId {
    std::int32_t group_x, group_y;
    std::int32_t thread_x, thread_y;
    std::int32_t dispatch_x, dispatch_y;
    std::int64_t index;
};

inline ThreadId thread_id(const ThreadGrid& grid, int x, int y) {
    return {x / group_size,
            y / group_size,
            x % group_size,
            y % group_size,
            x,
            y,
            static_cast<std::int64_t>(y) * grid.width + x};
}

// The points that one group covers, already cut to the cloth.
struct Tile {
    int row_begin, row_end, column_begin, column_end;
};

inline Tile tile_of_group(const ThreadGrid& grid, int group) {
    const int y = group / grid.groups_x() * group_size;
    const int x = group % grid.groups_x() * group_size;
    const auto cut = [](int end, int limit) { return end < limit ? end : limit; };
    return {y, cut(y + group_size, grid.height), x, cut(x + group_size, grid.width)};
}

}  // namespace clothsim
