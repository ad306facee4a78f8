// The contact of whole triangles with spheres: the end of the pass for continuous contact where a sphere
// keeps faces out.
//
//   1. Rows: triangles that lie on a sphere when the step begins, or reach it within the step.
//      Their corners go straight to the end of the free step (contact/triangle.hpp).
//      Points get rows too, for spheres that keep points out.
//   2. The contact problem of all rows (contact/contact_problem.hpp) gives positions and velocities.
//      An arrival leaves with the restitution times its speed; a resting contact is held.
//   3. The new paths are checked again, and new touches join the rows, until there are none.
//   4. The speed of a bounce follows from energy, springs included.
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
#include "memory/poll.hpp"
#include "model/scene.hpp"

namespace clothsim {

class FacePass {
public:
    virtual ~FacePass() = default;

    // The state when the step begins, and where the free step ends; the latter is replaced.
    std::vector<Vec3> x0, v0, x, v;
    std::vector<std::uint8_t> changed;  // whether x or v of a point was
    std::vector<Vec3> given;  // to the cloth by each sphere: momentum [N s]
    bool touched = false;  // whether a triangle or point was near enough to be checked

    // Throws Poll::Interrupted where the poll asks for the end. The state is then neither.
    virtual ContactReport run(const std::vector<SweptSphere>& spheres, Poll& poll) = 0;

    // Impulses of resting contacts in the newest step: the start of the next solve.
    struct PersistentContact {
        std::size_t feature;
        Vec3 place, speed;  // over the square of the time step [kg m/s^2], over the time step [N]
    };
    std::vector<PersistentContact> persistent;
};

// Whether impulses of one scene may serve another at time t. A feature counts the continuous spheres, so
// their number, order and kind must be the same. Each sphere may have moved.
bool keeps_persistent(const Scene& before, const Scene& after, double t);

// `faces`: of each continuous sphere, whether it keeps triangles out.
std::unique_ptr<FacePass> make_face_pass(const Scene& scene, const std::vector<bool>& faces,
                                         const FaceKernels& kernels);

}  // namespace clothsim
