// A picture of a cloth and its spheres: from where it is seen, what is drawn, and in which colours and light.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

namespace clothsim::picture {

using Triple = std::array<double, 3>;

inline double dot(const Triple& a, const Triple& b) { return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]; }
inline Triple operator-(const Triple& a, const Triple& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Triple operator*(double factor, const Triple& a) {
    return {factor * a[0], factor * a[1], factor * a[2]};
}
inline Triple operator+(const Triple& a, const Triple& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }

// Axes of the view are (right, up, towards the eye), its origin is the target.
struct View {
    int width = 0, height = 0;  // pixels
    int samples = 1;  // per pixel, along each axis
    std::array<Triple, 3> axes{};  // unit vectors
    Triple target{};  // m, drawn in the middle
    double scale = 1;  // samples per metre in the plane through the target
    double distance = 0;  // m, from the target to the eye; 0: orthographic

    int columns() const { return width * samples; }
    int rows() const { return height * samples; }
    bool perspective() const { return distance > 0; }
    // Cloth that lies on a sphere is up to rounding and chords of its cells below [m]: there it is drawn as
    // lying on it.
    double slack() const { return 1e-5 * columns() / scale; }
    Triple to_view(const Triple& p) const {
        const Triple way = p - target;
        return {dot(axes[0], way), dot(axes[1], way), dot(axes[2], way)};
    }
    Triple to_world(const Triple& v) const { return (v[0] * axes[0] + v[1] * axes[1]) + v[2] * axes[2]; }
};

// A sheet of rows x columns points, whose arrays hold three numbers a point. Its triangles are those of
// `triangles`.
struct Sheet {
    int rows = 0, columns = 0;
    const double* points = nullptr;  // m
    // Samples to the right, samples down, and nearness, which is linear in the picture. Nearness is metres
    // towards the eye, or in perspective 1 / (distance from the eye in m). A point behind the eye holds NaN.
    const double* screen = nullptr;
    const double* normals = nullptr;  // unit vectors, up where the sheet is flat
    const double* colors = nullptr;  // red, green, blue; null: each face has its own colour

    std::int64_t triangles() const {
        return rows > 1 && columns > 1 ? 2 * std::int64_t(rows - 1) * (columns - 1) : 0;
    }
    std::array<std::int64_t, 3> corners(std::int64_t triangle) const {
        const std::int64_t cell = triangle / 2, first = cell + cell / (columns - 1), below = first + columns;
        if (triangle % 2) return {first + 1, below, below + 1};
        return {first, below, first + 1};
    }
};

struct Ball {
    Triple center{};  // m
    double radius = 0;
    Triple color{};
    bool solid = true;  // cloth inside is painted red
};

// A horizontal plane that fades into the background.
struct Ground {
    bool drawn = false;
    double height = 0;  // m
    Triple middle{};  // m
    double radius = 0;  // m, where it has faded
};

struct Shading {
    Triple background{}, front{}, back{}, penetration{}, ground{};
    double full_red_depth = 0;  // m
    double least_red = 0;  // part of red at no depth
    Triple key{};  // unit vector to the light
    double ambient = 0, above = 0, key_light = 0, eye_light = 0;
    double grid_line = 0;  // half width of a line, in cells
    double grid_shade = 1;  // factor of the colour on a line
    bool shadow = false;
};

struct Picture {
    View view;
    Sheet sheet;
    std::vector<Ball> balls;
    Ground ground;
    Shading shading;
};

// Draw into `pixels`, height x width x 3. Pixels have the same bits for every number of threads.
// `interrupted` is asked by the calling thread, about every 10 ms; where it says true, drawing ends and the
// result is false.
bool render(const Picture& picture, int threads, const std::function<bool()>& interrupted,
            std::uint8_t* pixels);

}  // namespace clothsim::picture
