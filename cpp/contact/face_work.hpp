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
#include <utility>
#include <vector>

#include "contact/contact_problem.hpp"
#include "contact/face_pass.hpp"
#include "contact/triangle.hpp"

namespace clothsim {

// Of the radius: how far outside a sphere its surface lies. Half costs up to a sixth more rounds on drapes;
// twice saves a tenth, and cloth stands off twice as far.
inline constexpr double face_margin = 5e-7;

inline std::size_t at(int i) { return std::size_t(i); }

class FaceWork : public FacePass {
public:
    FaceWork(const Scene& scene, const std::vector<bool>& faces, const FaceKernels& kernels);
    ContactReport run(const std::vector<SweptSphere>& spheres) final;

private:
    struct Triangle {
        std::array<int, 3> corner;
        std::size_t number;
    };
    // Distances from the centre of a sphere: of what it holds from inside out.
    struct Shell {
        double inside, middle, surface, near;
    };
    // Of a sphere: the points as seen from it, as columns of x, y and z. Of each triangle: the directions of
    // a plane between the two, at the start and at the end.
    struct Frame {
        std::array<std::vector<double>, 3> start, end;
        std::array<std::array<std::vector<double>, 6>, 2> planes;  // of the triangles 2 i and 2 i + 1
        std::array<std::vector<double>, 2> heights;  // of them above the planes, in round 0 of the step

        static Vec3 at(const std::array<std::vector<double>, 3>& of, int i) {
            return {of[0][std::size_t(i)], of[1][std::size_t(i)], of[2][std::size_t(i)]};
        }
        static Corners corners(const std::array<std::vector<double>, 3>& of, const std::array<int, 3>& c) {
            return {at(of, c[0]), at(of, c[1]), at(of, c[2])};
        }
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
    static constexpr Sweeps all_sweeps{30, 100}, single_sweeps{400, 1};

    Corners corners(const std::vector<Vec3>& of, const std::array<int, 3>& corner) const;
    template <class Visit>
    void each_open_triangle(int sphere, double reach, int round, Visit visit);
    CellRow cell_row(const Frame& frame, int first) const;
    void note_drift();
    static void place(const std::vector<Vec3>& from, const double (&center)[3],
                      std::array<std::vector<double>, 3>& to);
    Frame& place_in_frame(int sphere);
    void set_plane(int sphere, const Triangle& triangle, const TriangleTouch& touch);
    void note_moves(int round);
    bool has_moved(const Triangle& triangle, int sphere) const;
    bool find_rows(int round);
    bool inspect_triangle(int sphere, const Triangle& triangle, int round);
    bool inspect_point(int sphere, int i, int round);
    bool add_row(int sphere, const Triangle& triangle, const Foot& foot, const Vec3& normal, double time,
                 int round);
    void set_foot(ContactRow& row, const std::array<double, 3>& weight) const;
    void follow_feet();
    void aim(ContactRow& row, Origin& origin, double depth, double time, int round);
    std::size_t feature(int sphere, const std::array<int, 3>& corner,
                        const std::array<double, 3>& weight) const;
    bool separated(int sphere, const Triangle& triangle, double reach) const;
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
    double farthest_place() const;
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
    std::vector<Shell> shells_;
    const FaceKernels& kernels_;
    std::vector<Frame> frames_;
    // Of rows of points: the farthest distance of a point from the end of its free step [m].
    std::vector<double> drift_;
    std::vector<Vec3> scratch_;  // of points
    std::vector<Vec3> free_x_, free_v_;  // where the free step ended
    std::vector<ContactRow> rows_;
    std::vector<ContactRow> begun_;  // before velocities responded at the end of a step with a bounce
    std::vector<Origin> origins_;
    std::vector<Vec3> inspected_x_;  // x at the inspection of a point's triangles
    std::vector<std::uint8_t> moved_;  // points that have left it
    std::vector<std::vector<std::uint8_t>> reached_;  // triangles with a touch at the inspection before
    std::vector<std::vector<std::size_t>> reached_list_;
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

// Triangles that no plane proves clear, beyond that distance from the centre; links of a chain. In round 0 of
// a step all heights above the planes are computed. Later a height has fallen by no more than the corners
// have moved since, `drift_`. Rounds before `most_rounds` leave out what has not moved.
template <class Visit>
void FaceWork::each_open_triangle(int sphere, double reach, int round, Visit visit) {
    const int rows = cloth_.rows, columns = cloth_.columns;
    if (rows == 1 || columns == 1) {
        for (int i = 0; i + 1 < cloth_.points(); ++i) {
            const Triangle t{{i, i + 1, i + 1}, 2 * at(i)};
            if (!separated(sphere, t, reach)) visit(t);
        }
        return;
    }
    Frame& frame = frames_[at(sphere)];
    const auto open = [&](const Triangle& t) {
        return round == 0 || ((round == most_rounds || has_moved(t, sphere)) && !separated(sphere, t, reach));
    };
    for (int r = 0; r + 1 < rows; ++r) {
        const int first = r * columns;
        double *const upper = frame.heights[0].data() + first, *const lower = frame.heights[1].data() + first;
        if (round == 0) kernels_.heights(cell_row(frame, first), upper, lower);
        const double enough = round == 0 ? reach : reach + std::max(drift_[at(r)], drift_[at(r + 1)]);
        for (int c = 0; c + 1 < columns; ++c) {
            const int i = first + c, below = i + columns;
            const Triangle one{{i, i + 1, below}, 2 * at(i)}, other{{i + 1, below + 1, below}, 2 * at(i) + 1};
            if (!(upper[c] > enough) && open(one)) visit(one);
            if (!(lower[c] > enough) && open(other)) visit(other);
        }
    }
}

}  // namespace clothsim
