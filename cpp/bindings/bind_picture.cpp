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
    picture::Shading shading;
    shading.background = colors.at("background");
    shading.front = colors.at("front");
    shading.back = colors.at("back");
    shading.penetration = colors.at("penetration");
    shading.ground = colors.at("ground");
    shading.full_red_depth = full_red_depth;
    shading.least_red = least_red;
    shading.key = key;
    shading.ambient = light[0];
    shading.above = light[1];
    shading.key_light = light[2];
    shading.eye_light = light[3];
    shading.grid_line = grid_line;
    shading.grid_shade = grid_shade;
    return shading;
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
    py::class_<picture::View>(m, "View").def(py::init(&make_view), py::kw_only(), py::arg("width"),
                                             py::arg("height"), py::arg("samples"), py::arg("axes"),
                                             py::arg("target"), py::arg("scale"), py::arg("distance"));
    py::class_<picture::Shading>(m, "Shading")
        .def(py::init(&make_shading), py::kw_only(), py::arg("colors"), py::arg("full_red_depth"),
             py::arg("least_red"), py::arg("key"), py::arg("light"), py::arg("grid_line"),
             py::arg("grid_shade"));
    m.def("render", &render, py::kw_only(), py::arg("view"), py::arg("shading"), py::arg("points"),
          py::arg("screen"), py::arg("normals"), py::arg("colors"), py::arg("balls"), py::arg("ground"),
          py::arg("shadow"), py::arg("threads"));
}

}  // namespace clothsim
