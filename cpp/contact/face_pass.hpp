// The contact of whole triangles with spheres: the end of the pass for continuous contact where a sphere
// keeps faces out.
//
//   1. Rows: triangles that lie on a sphere when the step begins, and triangles that reach it on the straight
//   way of their
//      corners to where the free step ends (contact/triangle.hpp); points, for spheres that keep points out.
//   2. The contact problem of all rows (contact/contact_problem.hpp), for the positions at the end of the
//   step and for the
//      velocities there. What arrives leaves with the restitution times the speed of arrival; what rests is
//      held.
//   3. The new ways are looked along again, and what they reach joins the rows, until they reach nothing.
//   4. Where something bounced, its speed is what the energy leaves, springs included.
//
// The surface lies a margin outside the sphere: so much may the positions be off that step 2 finds.
// Velocities are judged at that surface. A way back to it changes positions alone.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "contact/contact_report.hpp"
#include "kernels/contact/continuous.hpp"
#include "kernels/contact/face_kernels.hpp"
#include "model/scene.hpp"

namespace clothsim {

class FacePass {
public:
    virtual ~FacePass() = default;

    // The state when the step begins, and where the free step ends; the latter is replaced.
    std::vector<Vec3> x0, v0, x, v;
    std::vector<std::uint8_t> changed;  // whether x or v of a point was
    bool touched = false;  // whether a triangle or point was near enough to be looked at

    virtual ContactReport run(const std::vector<SweptSphere>& spheres) = 0;

    // Impulses of what lies on the spheres, of the newest step: where the next begins to look for its own.
    struct PersistentContact {
        std::size_t feature;
        Vec3 place, speed;  // over the square of the time step [kg m/s^2], over the time step [N]
    };
    std::vector<PersistentContact> persistent;
};

// Whether impulses of one scene may serve another at time t: a feature counts the continuous spheres, so
// their number, order and kind must be the same. Each sphere may have moved.
bool keeps_persistent(const Scene& before, const Scene& after, double t);

// `faces`: of each continuous sphere, whether it keeps triangles out.
std::unique_ptr<FacePass> make_face_pass(const Scene& scene, const std::vector<bool>& faces,
                                         const FaceKernels& kernels);

}  // namespace clothsim
