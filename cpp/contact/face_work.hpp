// How the pass for faces (contact/face_pass.hpp) works: what it holds for a step, and its parts.
//
//   distances from a centre (Shell)          |<-------------- near: inspected further ------------->|
//                                 centre ----|inside|--middle--|surface|----------------------------|
//                                            |<----- margin ---------->|   places lie in the margin
//
//   run()  --> follow_ways     find_rows: triangles and points that touch (face_search.cpp, face_rows.cpp)
//                              solve: their positions, then their velocities (contact_problem.hpp)
//                              new paths touch something? find_rows again, until nothing touches
//          --> restore_speeds  of bounces, from their energy (face_energy.cpp); else ground() and again
//          --> project         if rows never ended: places alone
//          --> push_out_all    what was inside when the step began
//          --> fault_of_place  below, thrown or with too much energy? then search() for another place
//          --> save_persistent impulses, for the start of the next step's solve
//
// search() begins at several places (starts): the free end of the step, the sheet carried by each sphere, the
// sheet pressed against planes between spheres. If all fail, planes move with the spheres
// (move_with_spheres).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "contact/contact_problem.hpp"
#include "contact/face_broad_phase.hpp"
#include "contact/face_pass.hpp"

namespace clothsim {

// Of the radius: how far outside a sphere its surface lies. Half costs up to a sixth more rounds on drapes;
// twice saves a tenth, and cloth stands off twice as far.
inline constexpr double face_margin = 5e-7;
// Part of a triangle. Nearer to a pinned corner a sphere has run into that corner: its neighbours would fly
// at more than 100 times its speed. Half allows 200 times; twice calls more touches hits of the pin.
inline constexpr double least_lever = 0.01;

class FaceWork : public FacePass {
public:
    FaceWork(const Scene& scene, const std::vector<bool>& faces, const FaceKernels& kernels);
    ContactReport run(const std::vector<SweptSphere>& spheres, Poll& poll) final;

private:
    using Triangle = FaceBroadPhase::Triangle;
    using Frame = FaceBroadPhase::Frame;
    // Distances from the centre of a sphere: of what it holds from inside out.
    struct Shell {
        double inside, middle, surface, near;
    };
    // Of a row of the contact problem.
    struct Origin {
        int sphere;
        std::size_t feature;
        std::size_t piece;  // the triangle's number, or the point's
        int round;
        double time;  // of the touch, as part of the step
        double arrival = 0;  // normal speed with which it comes to the surface [m/s]
        double height = 0;  // above the surface that it reaches by the end of the step [m]

        bool rests() const { return time == 0; }  // in contact when the step begins
    };

    // Faults of the place at which a step would end.
    struct Fault {
        int point = -1;  // it passes a sphere, is too far off, or has too much energy; -1: none
        double energy = 0;  // made beyond the bound [J]
    };
    // A plane that moves with a sphere: points behind it are outside the sphere.
    struct HalfSpace {
        Vec3 normal;
        double level;
    };

    // How a projection works: rounds of new rows, and sweeps over the rows of each.
    struct Sweeps {
        int rounds, most;
    };
    // Of a solve; a bound. Half changes a violent shot by 1e-7 m; twice changes nothing.
    static constexpr int most_rounds = 24;
    static constexpr std::size_t pieces_of_touch = 8;  // see CountedPoll: a triangle that is inspected
    static constexpr Sweeps all_sweeps{30, 100}, single_sweeps{400, 1};

    Corners corners(const std::vector<Vec3>& of, const std::array<int, 3>& corner) const;
    const Frame& place_in_frame(int sphere);
    bool find_rows(int round);
    bool inspect_triangle(int sphere, const Triangle& triangle, int round);
    bool inspect_point(int sphere, int i, int round);
    bool add_row(int sphere, const Triangle& triangle, const Foot& foot, const Vec3& normal, double time,
                 int round);
    void set_foot(ContactRow& row, const std::array<double, 3>& weight) const;
    void act_between(ContactRow& row, const std::array<double, 3>& first) const;
    void follow_feet();
    void aim(ContactRow& row, Origin& origin, double depth, double time, int round);
    std::size_t feature(int sphere, const std::array<int, 3>& corner,
                        const std::array<double, 3>& weight) const;
    void solve(std::size_t first, ContactSide side);
    void solve_side(std::size_t first, std::vector<Vec3>& z, ContactSide side, double tolerance, double quiet,
                    int most);
    void restore_persistent(double dt);
    void save_persistent(double dt);
    bool project(const Sweeps& sweeps);
    bool place_rows();
    Fault search(Fault fault);
    std::vector<std::vector<Vec3>> starts() const;
    template <class Visit>
    void each_blocked(Visit visit);
    int unresolved();
    double longest_ways() const;
    double farthest_place() const;
    double largest_speed_change() const;
    double most_energy_made() const;
    Fault fault_of_place();
    bool nearest_in(const std::vector<HalfSpace>& all, int point, Vec3& nearest) const;
    bool move_with_spheres();
    void take_path_speeds();
    void ground();
    bool follow_ways(int first_round);
    bool restore_speeds();
    bool bounced() const;
    bool flies() const;
    double energy_made() const;
    double energy_lacking() const;
    Vec3 acted_on(const ContactRow& row, const std::vector<Vec3>& velocities) const;
    Vec3 to_cloth(const ContactRow& row, const Vec3& impulse) const;
    void note_given();
    int nearest_sphere(const Vec3& place) const;
    double elastic_change() const;
    void push_out_all();
    bool push_out(int sphere, const Triangle& triangle);
    void note_changed();
    int pinned_corner(const std::array<int, 3>& corner) const;

    const Scene& scene_;
    const Cloth& cloth_;
    std::vector<bool> faces_;
    const std::vector<SweptSphere>* spheres_ = nullptr;
    std::optional<CountedPoll> poll_;
    std::vector<Shell> shells_;
    FaceBroadPhase broad_phase_;
    std::vector<Vec3> scratch_;  // of points
    std::vector<Vec3> free_x_, free_v_;  // where the free step ended
    std::vector<ContactRow> rows_;
    std::vector<ContactRow> begun_;  // before velocities responded at the end of a step with a bounce
    std::vector<Origin> origins_;
    // Triangles and points whose velocity responds between start and end.
    std::vector<std::vector<std::uint8_t>> followed_;
    SolverMemory memory_;
    std::vector<double> sum_;
    std::vector<double> stiffness_;  // of all springs of a point together [N/m]
    double further_work_ = 0;  // of moving spheres, beside that of the rows' impulses [J]
    std::vector<Vec3> further_;  // momentum given by each sphere, beside those impulses [N s]
    std::vector<double> pushed_;
    std::vector<std::vector<std::uint8_t>> inside_;  // triangles, points that were inside when the step began
    std::vector<std::pair<int, Triangle>> starts_inside_;
    std::vector<std::uint32_t> seen_;  // features: the inspection in which they got a row
    std::vector<std::uint32_t> persistent_at_;  // features: place in `persistent`, plus 1
    std::uint32_t inspection_ = 0;
    bool grounded_ = false;  // whether what bounces stays at the surface in this step
    ContactReport report_;
};

}  // namespace clothsim
