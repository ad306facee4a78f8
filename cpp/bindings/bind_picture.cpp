// Pictures of a sheet, spheres and planes.
#include <map>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "memory/threads.hpp"
#include "picture/picture.hpp"

namespace clothsim {
namespace {

using picture::Triple;

picture::Shading make_shading(const std::map<std::string, Triple>& colors, double full_red_depth,
                              double least_red, const Triple& key,
                              const std::array<double, 4>& light, double grid_line,
                              double grid_shade, const std::array<double, 3>& plane_grid,
                              bool shadow, const std::vector<Triple>& depth_colors,
                              const std::array<double, 2>& depth_range) {
    return {.background = colors.at("background"),
            .front = colors.at("front"),
            .back = colors.at("back"),
            .penetration = colors.at("penetration"),
            .full_red_depth = full_red_depth,
            .least_red = least_red,
            .key = key,
            .ambient = light[0],
            .above = light[1],
            .key_light = light[2],
            .eye_light = light[3],
            .grid_line = grid_line,
            .grid_shade = grid_shade,
            .plane_cell = plane_grid[0],
            .plane_line = plane_grid[1],
            .plane_shade = plane_grid[2],
            .shadow = shadow,
            .depth_colors = depth_colors,
            .depth_range = depth_range};
}

// Arrays of the sheet have shape (rows, columns, 3). Rows of `balls`: centre, radius, colour, solid
// or not; of `planes`: point, normal, radius, colour, solid or not, two directions of a grid, and
// a crossing of its lines.
py::array_t<std::uint8_t> render(const picture::View& view, const picture::Shading& shading,
                                 const Array<double>& points, const Array<double>& screen,
                                 const Array<double>& normals,
                                 const std::optional<Array<double>>& colors,
                                 const std::vector<std::array<double, 8>>& balls,
                                 const std::vector<std::array<double, 20>>& planes, int threads) {
    if (points.ndim() != 3 || screen.size() != points.size() || normals.size() != points.size() ||
        (colors && colors->size() != points.size()))
        throw std::invalid_argument("arrays of the sheet must have one shape (rows, columns, 3)");
    picture::Picture drawn{
        .view = view,
        .sheet = {int(points.shape(0)), int(points.shape(1)), points.data(), screen.data(),
                  normals.data(), colors ? colors->data() : nullptr},
        .balls = {},
        .planes = {},
        .shading = shading};
    for (const auto& b : balls)
        drawn.balls.push_back({{b[0], b[1], b[2]}, b[3], {b[4], b[5], b[6]}, b[7] != 0});
    for (const auto& p : planes)
        drawn.planes.push_back({.point = {p[0], p[1], p[2]},
                                .normal = {p[3], p[4], p[5]},
                                .radius = p[6],
                                .color = {p[7], p[8], p[9]},
                                .solid = p[10] != 0,
                                .lines = {Triple{p[11], p[12], p[13]}, Triple{p[14], p[15], p[16]}},
                                .node = {p[17], p[18], p[19]}});
    py::array_t<std::uint8_t> pixels(
        {py::ssize_t(view.height), py::ssize_t(view.width), py::ssize_t(3)});
    std::uint8_t* const out = pixels.mutable_data();
    threads = granted_threads(threads);
    bool complete;
    {
        Unlocked unlocked;
        complete = picture::render(drawn, threads, [&] { return unlocked.signal_pending(); }, out);
    }
    if (!complete) throw py::error_already_set();
    return pixels;
}

}  // namespace

void bind_picture(py::module_& m) {
    py::class_<picture::View>(m, "View").def(
        py::init<int, int, std::array<Triple, 3>, Triple, double, double>(), py::kw_only(),
        "width"_a, "height"_a, "axes"_a, "target"_a, "scale"_a, "distance"_a);
    py::class_<picture::Shading>(m, "Shading")
        .def(py::init(&make_shading), py::kw_only(), "colors"_a, "full_red_depth"_a, "least_red"_a,
             "key"_a, "light"_a, "grid_line"_a, "grid_shade"_a, "plane_grid"_a, "shadow"_a,
             "depth_colors"_a, "depth_range"_a);
    m.attr("SAMPLES") = picture::samples;
    m.attr("LIGHT_SIZE") = picture::light_size;
    m.attr("PLANE_TONE") = picture::plane_tone;
    m.attr("PLANE_IN_SHADOW") = picture::plane_in_shadow;
    m.def("render", &render, py::kw_only(), "view"_a, "shading"_a, "points"_a, "screen"_a,
          "normals"_a, "colors"_a, "balls"_a, "planes"_a, "threads"_a);
}

}  // namespace clothsim
