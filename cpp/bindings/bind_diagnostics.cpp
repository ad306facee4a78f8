#include <pybind11/eigen.h>

#include "bindings/bindings.hpp"
#include "collision/triangle.hpp"
#include "model/thread_grid.hpp"
#include "simulation/diagnostics.hpp"

namespace clothsim {
namespace {

PointsView view(const Array<double>& a) { return {a.data(), a.size() / 3, 3}; }

py::array_t<ThreadId> thread_ids(int rows, int columns) {
    const ThreadGrid grid{columns, rows};
    py::array_t<ThreadId> ids({py::ssize_t(rows), py::ssize_t(columns)});
    auto out = ids.mutable_unchecked<2>();
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < columns; ++x) out(y, x) = thread_id(grid, x, y);
    return ids;
}

}  // namespace

void bind_diagnostics(py::module_& m) {
    PYBIND11_NUMPY_DTYPE(ThreadId, group_x, group_y, thread_x, thread_y, dispatch_x, dispatch_y, index);
    m.attr("group_size") = group_size;
    m.def("thread_ids", &thread_ids);
    m.def("triangles", &triangles);
    m.def("energy", [](const Cloth& cloth, const Vec3& gravity, const Array<double>& x, const Array<double>& v) {
        const Energy e = energy(cloth, gravity, view(x), view(v));
        return py::make_tuple(e.kinetic, e.elastic, e.gravity);
    });
    m.def("largest_stretch", [](const Cloth& cloth, const Array<double>& x) { return largest_stretch(cloth, view(x)); });
    m.def("triangle_touches", [](const Array<double>& p0, const Array<double>& p1, double reach, double tolerance) {
        const py::ssize_t count = p0.size() / 9;
        py::array_t<double> times(count);
        double* const out = times.mutable_data();
        const auto corners = [](const double* p) { return Corners{Vec3(p), Vec3(p + 3), Vec3(p + 6)}; };
        for (py::ssize_t i = 0; i < count; ++i) {
            const TriangleTouch t = triangle_touch(corners(p0.data() + 9 * i), corners(p1.data() + 9 * i), reach, tolerance);
            out[i] = t.hit ? t.time : std::numeric_limits<double>::quiet_NaN();
        }
        return times;
    });
    m.def("penetration", [](int rows, int columns, const Array<double>& x, const Vec3& center, double radius) {
        const Penetration p = penetration(rows, columns, view(x), center, radius);
        return py::make_tuple(p.points, p.triangles);
    });
}

}  // namespace clothsim
