// Pictures of a sheet and spheres.
#include <map>
#include <optional>

#include "bindings/bindings.hpp"
#include "bindings/unlocked.hpp"
#include "picture/frame.hpp"

namespace clothsim {
namespace {

using picture::Triple;

picture::View make_view(int width, int height, int samples, const std::array<Triple, 3>& axes,
                        const Triple& target, double scale, double distance) {
    return {width, height, samples, axes, target, scale, distance};
}

picture::Shading make_shading(const std::map<std::string, Triple>& colors, double full_red_depth,
                              double least_red, const Triple& key, const std::array<double, 4>& light,
                              double grid_line, double grid_shade) {
    return {.background = colors.at("background"),
            .front = colors.at("front"),
            .back = colors.at("back"),
            .penetration = colors.at("penetration"),
            .ground = colors.at("ground"),
            .full_red_depth = full_red_depth,
            .least_red = least_red,
            .key = key,
            .ambient = light[0],
            .above = light[1],
            .key_light = light[2],
            .eye_light = light[3],
            .grid_line = grid_line,
            .grid_shade = grid_shade};
}

// Arrays of the sheet have shape (rows, columns, 3); those of balls one row a ball: centre, radius, colour,
// solid or not.
py::array_t<std::uint8_t> render(const picture::View& view, picture::Shading shading,
                                 const Array<double>& points, const Array<double>& screen,
                                 const Array<double>& normals, const std::optional<Array<double>>& colors,
                                 const Array<double>& balls,
                                 const std::optional<std::array<double, 5>>& ground, bool shadow,
                                 int threads) {
    if (points.ndim() != 3 || screen.size() != points.size() || normals.size() != points.size() ||
        (colors && colors->size() != points.size()))
        throw std::invalid_argument("arrays of the sheet must have one shape (rows, columns, 3)");
    picture::Picture drawn;
    drawn.view = view;
    drawn.sheet = {int(points.shape(0)), int(points.shape(1)), points.data(),
                   screen.data(),        normals.data(),       colors ? colors->data() : nullptr};
    for (py::ssize_t i = 0; i < balls.size() / 8; ++i) {
        const double* const b = balls.data() + 8 * i;
        drawn.balls.push_back({{b[0], b[1], b[2]}, b[3], {b[4], b[5], b[6]}, b[7] != 0});
    }
    if (ground) drawn.ground = {true, (*ground)[0], {(*ground)[1], (*ground)[2], (*ground)[3]}, (*ground)[4]};
    shading.shadow = shadow;
    drawn.shading = shading;
    py::array_t<std::uint8_t> pixels({py::ssize_t(view.height), py::ssize_t(view.width), py::ssize_t(3)});
    std::uint8_t* const out = pixels.mutable_data();
    threads = granted(threads);
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
    py::class_<picture::View>(m, "View").def(py::init(&make_view), py::kw_only(), "width"_a, "height"_a,
                                             "samples"_a, "axes"_a, "target"_a, "scale"_a, "distance"_a);
    py::class_<picture::Shading>(m, "Shading")
        .def(py::init(&make_shading), py::kw_only(), "colors"_a, "full_red_depth"_a, "least_red"_a, "key"_a,
             "light"_a, "grid_line"_a, "grid_shade"_a);
    m.def("render", &render, py::kw_only(), "view"_a, "shading"_a, "points"_a, "screen"_a, "normals"_a,
          "colors"_a, "balls"_a, "ground"_a, "shadow"_a, "threads"_a);
}

}  // namespace clothsim
