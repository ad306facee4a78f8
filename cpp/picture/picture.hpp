// A picture of a cloth, spheres and planes: from where it is seen, what is drawn, and in which
// colours and light.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

namespace clothsim::picture {

using Triple = std::array<double, 3>;

inline double dot(const Triple& a, const Triple& b) {
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2];
}
inline Triple operator-(const Triple& a, const Triple& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Triple operator+(const Triple& a, const Triple& b) {
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
inline Triple operator*(double factor, const Triple& a) {
    return {factor * a[0], factor * a[1], factor * a[2]};
}

// A line of sight: from the eye, or of an orthographic view from the plane through the target.
struct Ray {
    Triple start{}, to_eye{};  // m, unit vector
    Triple at(double way) const { return start - way * to_eye; }  // `way` metres along
};

inline constexpr int samples = 2;  // of a pixel, along each axis
// Tangent of the angle at which a point sees the light's radius: at half, shadows have hard edges.
inline constexpr double light_size = 0.15;
inline constexpr double plane_in_shadow = 0.7;  // factor of a plane's colour in full shadow
// Part of the light on a cloth that planes take, so that the walls of a room differ; at 0 none do,
// at 1 walls are darker than cloth in front of them.
inline constexpr double plane_tone = 0.35;

// Axes of the view are (right, up, towards the eye), its origin is the target.
struct View {
    int width = 0, height = 0;  // pixels
    std::array<Triple, 3> axes{};  // unit vectors
    Triple target{};  // m, drawn in the middle
    double scale = 1;  // samples per metre in the plane through the target
    double distance = 0;  // m, from the target to the eye; 0: orthographic

    int columns() const { return width * samples; }
    int rows() const { return height * samples; }
    bool perspective() const { return distance > 0; }
    // Metres up to which cloth below a surface is drawn as lying on it: rounding, and chords of its
    // cells.
    double slack() const { return 1e-5 * columns() / scale; }
    Triple to_view(const Triple& p) const {
        const Triple way = p - target;
        return {dot(axes[0], way), dot(axes[1], way), dot(axes[2], way)};
    }
    Triple to_world(const Triple& v) const {
        return (v[0] * axes[0] + v[1] * axes[1]) + v[2] * axes[2];
    }
    // Through a place in samples to the right and down; the middle of a sample is at one half.
    Ray ray(double column, double row) const {
        const double x = (column - 0.5 * columns()) / scale, y = (0.5 * rows() - row) / scale;
        if (!perspective()) return {target + to_world({x, y, 0.0}), axes[2]};
        const double length = std::sqrt(x * x + y * y + distance * distance);
        return {target + distance * axes[2], (1 / length) * to_world({-x, -y, distance})};
    }
    // Metres towards the eye, or in perspective 1 / (distance from the eye in m): linear in the
    // picture.
    double nearness(const Ray& ray, double way) const {
        return perspective() ? 1 / (way * dot(ray.to_eye, axes[2])) : -way;
    }
};

// A sheet of rows x columns points, whose arrays hold three numbers a point. Its triangles are
// those of `triangles`.
struct Sheet {
    int rows = 0, columns = 0;
    const double* points = nullptr;  // m
    const double* screen = nullptr;  // samples right, samples down, nearness; NaN behind the eye
    const double* normals = nullptr;  // unit vectors, up where the sheet is flat
    const double* colors = nullptr;  // red, green, blue; null: each face has its own colour

    std::int64_t triangles() const {
        return rows > 1 && columns > 1 ? 2 * std::int64_t(rows - 1) * (columns - 1) : 0;
    }
    std::array<std::int64_t, 3> corners(std::int64_t triangle) const {
        const std::int64_t cell = triangle / 2, first = cell + cell / (columns - 1),
                           below = first + columns;
        if (triangle % 2) return {first + 1, below, below + 1};
        return {first, below, first + 1};
    }
};

struct Ball {
    Triple center{};  // m
    double radius = 0;
    Triple color{};
    bool solid = true;  // cloth inside is shown
};

// Seen from the side of its normal; fades into the background.
struct Plane {
    Triple point{}, normal{};  // m, unit vector
    double radius = 0;  // m around `point`, where it has faded
    Triple color{};
    bool solid = false;  // cloth below is shown
    // A grid has lines along these two unit vectors, and a crossing at `node` [m]; zero vectors:
    // none.
    std::array<Triple, 2> lines{};
    Triple node{};
};

struct Shading {
    Triple background{}, front{}, back{}, penetration{};
    double full_red_depth = 0, least_red = 0;  // m, and the part of red at no depth
    Triple key{};  // unit vector to the light
    double ambient = 0, above = 0, key_light = 0, eye_light = 0;
    // Half width of a line in cells, and its factor of the colour.
    double grid_line = 0, grid_shade = 1;
    // The grid of a plane: a cell and half the width of a line [m], and its factor of the colour.
    double plane_cell = 1, plane_line = 0, plane_shade = 1;
    bool shadow = false;
    // Colours at equal steps of depth, for a cloth that is coloured by depth; else empty.
    std::vector<Triple> depth_colors;
    std::array<double, 2> depth_range{};  // m, of the first and the last of these colours
};

struct Picture {
    View view;
    Sheet sheet;
    std::vector<Ball> balls;
    std::vector<Plane> planes;
    Shading shading;
};

// Draw into `pixels`, height x width x 3, with the same bits for every number of threads. The
// calling thread asks `interrupted` about every 10 ms; where it says true, the result is false.
bool render(const Picture& picture, int threads, const std::function<bool()>& interrupted,
            std::uint8_t* pixels);

}  // namespace clothsim::picture
