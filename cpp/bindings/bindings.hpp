// Python touches the core here and nowhere else.
#pragma once

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "model/scene.hpp"

namespace py = pybind11;
using namespace pybind11::literals;

namespace clothsim {

// Arrays arrive checked by the Python layer: C order, aligned, the very dtype.
template <class T>
using Array = py::array_t<T, py::array::c_style>;

inline PointsView view(const Array<double>& a) { return {a.data(), a.size() / 3, 3}; }

void bind_build(py::module_& m);
void bind_model(py::module_& m);
void bind_picture(py::module_& m);
void bind_simulation(py::module_& m);
void bind_measures(py::module_& m);
void bind_reference(py::module_& m);

}  // namespace clothsim
