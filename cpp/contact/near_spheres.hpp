// The spheres at the end of a step. Beside a sphere there may be a plane that keeps it from a band of rows.
// No point of a row altogether beyond that plane is inspected.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "contact/response.hpp"
#include "contact/separation.hpp"
#include "kernels/kernel_table.hpp"

namespace clothsim {

// The kernels' test takes a squared radius that is larger by this many epsilon, as its sum of squares may be
// rounded by three. With half of it the test would still be safe, with twice as much it would find a few more
// points that touch nothing.
inline constexpr double outer_epsilons = 8;

template <class Real>
struct NearSpheres {
    std::vector<Contact> contacts;
    std::vector<SphereOutline<Real>> outlines;

    // The contacts were set to another time. `extent_along(k)`: of the band along x, y or z.
    template <class ExtentAlong>
    void place(const ExtentAlong& extent_along) {
        outlines.resize(contacts.size(), {{}, 0, -1, false, 0, true});
        bool crossed = false;
        for (std::size_t i = 0; i < contacts.size(); ++i) {
            const Contact& contact = contacts[i];
            SphereOutline<Real>& outline = outlines[i];
            for (int k = 0; k < 3; ++k) outline.center[k] = Real(contact.center[k]);
            outline.radius_squared = outer_radius_squared(contact.sphere);
            crossed |= outline.crossed;
        }
        if (crossed && --steps_to_planes_ <= 0) find_planes(extent_along);
        for (std::size_t i = 0; i < contacts.size(); ++i) {
            SphereOutline<Real>& outline = outlines[i];
            if (outline.axis < 0) continue;
            const double center = contacts[i].center[outline.axis], reach = reach_of_plane(contacts[i]);
            outline.plane = Real(outline.above ? center + reach : center - reach);
        }
    }

    // The radius of the kernels' test may find a point too many, never one too few. The response decides.
    static Real outer_radius_squared(const Sphere& sphere) {
        const double r = sphere.contact_radius;
        return Real(r * r * (1 + outer_epsilons * double(std::numeric_limits<Real>::epsilon())));
    }

    // A point as far from the centre along one axis is outside for the kernel's test too, with any
    // rounding.
    static double reach_of_plane(const Contact& contact) {
        const double radius = contact.sphere.contact_radius;
        return radius + 1e-6 * (radius + contact.center.cwiseAbs().maxCoeff());
    }

private:
    // Least number of steps between two searches for planes, where a band comes near a sphere. Half or twice
    // changes drapes by less than the spread, 3 %.
    static constexpr int steps_between_planes = 64;

    // For every sphere the plane from which the band is farthest now. Only a guess: each row of each step is
    // asked whether it is beyond.
    template <class ExtentAlong>
    void find_planes(const ExtentAlong& extent_along) {
        steps_to_planes_ = steps_between_planes;
        Box band;  // where there is padding, up to far above
        for (int k = 0; k < 3; ++k) {
            const Extent<Real> extent = extent_along(k);
            band.low[k] = double(extent.low);
            band.high[k] = double(extent.high);
        }
        for (std::size_t i = 0; i < contacts.size(); ++i) {
            const Vec3 reach = Vec3::Constant(reach_of_plane(contacts[i]));
            const auto gap =
                widest_separation(band, {contacts[i].center - reach, contacts[i].center + reach});
            outlines[i].axis = gap ? gap->axis : -1;
            outlines[i].above = gap && gap->above;
            outlines[i].crossed = !gap;
        }
    }

    int steps_to_planes_ = 0;  // until the next search for planes
};

}  // namespace clothsim
