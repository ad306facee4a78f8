// Penalty contact of a whole cloth: depths, energy and bounds of a state.
#pragma once

#include <algorithm>
#include <vector>

#include "forces/penalty.hpp"
#include "model/scene.hpp"

namespace clothsim {

// The deepest free point in the layer of an obstacle.
struct Depth {
    double depth = 0;  // m, above 0 in contact
    int point = -1;
};

// Calls `visit(number, contact, i, gap)` for each free mass point in the layer of an obstacle at
// the time t. `each_free_point(see)` calls see(i, x) for each of them, relative to the origin of
// the obstacles.
template <class EachFree, class Visit>
void each_contact(const Scene& scene, double t, EachFree each_free_point, Visit visit) {
    for (std::size_t number = 0; number < scene.spheres.size(); ++number) {
        const Sphere& sphere = scene.spheres[number];
        if (!sphere.penalty()) continue;
        const PenaltyContact contact(sphere, StageTime::at_rest(t));
        each_free_point([&](int i, const Vec3& x) {
            if (contact.is_beyond_layer(x)) return;
            const PenaltyContact::Gap gap = contact.at(x);
            if (gap.depth > 0) visit(number, contact, i, gap);
        });
    }
}

// Visits the free points of a state, see each_contact.
inline auto each_free_of(const Cloth& cloth, const PointsView& x) {
    return [&cloth, x](auto see) {
        for (int i = 0; i < cloth.points(); ++i)
            if (!cloth.pinned[std::size_t(i)]) see(i, Vec3(x.row(i)));
    };
}

template <class EachFree>
std::vector<Depth> contact_depths(const Scene& scene, double t, EachFree each_free_point) {
    std::vector<Depth> depths(scene.spheres.size());
    each_contact(scene, t, each_free_point,
                 [&](std::size_t number, const PenaltyContact&, int i, const auto& gap) {
                     if (gap.depth > depths[number].depth) depths[number] = {gap.depth, i};
                 });
    return depths;
}

// Returns whether a free point has left the layer of an obstacle on its inner side: the law ends
// there.
inline bool beyond_layer(const Sphere& sphere, double depth) {
    return sphere.penalty() && depth > 2 * sphere.thickness;
}

}  // namespace clothsim
