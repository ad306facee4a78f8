// How the pass for faces (contact/face_pass.hpp) works: what it holds for a step, and its parts.
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

// Of the radius: how far outside a sphere its surface lies.
inline constexpr double face_margin = 5e-7;

inline std::size_t at(int i) { return std::size_t(i); }

class FaceWork : public FacePass {
public:
    FaceWork(const Cloth& cloth, const Vec3& gravity, const std::vector<bool>& faces);
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
    // Of a row of the contact problem.
    struct Origin {
        int sphere;
        std::size_t feature;
        double arrival = 0;  // normal speed with which it comes to the surface [m/s]
        double height = 0;   // above the surface that it reaches by the end of the step [m]
    };

    Corners corners(const std::vector<Vec3>& of, const std::array<int, 3>& corner) const;
    template <class Visit>
    void each_near_triangle(int sphere, Visit visit);
    void place_in_frame(int sphere);
    void note_moves(int round);
    bool has_moved(const Triangle& triangle, int sphere) const;
    bool find_rows(int round);
    bool look_along(int sphere, const Triangle& triangle, int round);
    bool look_at_point(int sphere, int i, int round);
    bool add_row(int sphere, const std::array<int, 3>& corner, const Foot& foot, const Vec3& normal, double time, int round);
    void aim(ContactRow& row, Origin& origin, double depth, double time, int round);
    std::size_t feature(int sphere, const std::array<int, 3>& corner, const std::array<double, 3>& weight) const;
    bool separated(int sphere, const Triangle& triangle, double reach) const;
    void solve(std::size_t first, ContactSide side);
    void solve_side(std::size_t first, std::vector<Vec3>& z, ContactSide side, double tolerance, double quiet, int most);
    void recall(double dt);
    void remember(double dt);
    bool project();
    void ground();
    bool follow_ways(int first_round);
    bool restore_speeds();
    bool bounced() const;
    double energy_lacking() const;
    double elastic_change() const;
    void push_out_all();
    bool push_out(int sphere, const Triangle& triangle);
    void note_left_over();
    void note_changed();
    int pinned_corner(const std::array<int, 3>& corner) const;

    const Cloth& cloth_;
    Vec3 gravity_;
    std::vector<bool> faces_;
    const std::vector<SweptSphere>* spheres_ = nullptr;
    std::vector<Shell> shells_;
    std::vector<Vec3> start_, end_;        // in a sphere's frame
    std::vector<Vec3> free_x_, free_v_;    // where the free step ended
    std::vector<ContactRow> rows_;
    std::vector<Origin> origins_;
    std::vector<Vec3> looked_x_;                         // x as it was when a point's triangles were looked at
    std::vector<std::uint8_t> moved_;                    // points that have left it
    std::vector<std::vector<std::uint8_t>> reached_;     // triangles for which the look before found something
    SolverMemory memory_;
    std::vector<double> sum_;
    std::vector<double> pushed_;
    // Directions of a plane between triangle and sphere, as the way begins and ends.
    std::vector<std::vector<std::array<Vec3, 2>>> planes_;
    std::vector<std::vector<std::uint8_t>> inside_;      // triangles, points that were inside when the step began
    std::vector<std::pair<int, Triangle>> starts_inside_;
    std::vector<std::uint32_t> seen_;                    // features: in which look they got a row
    std::vector<std::uint32_t> lasted_;                  // features: place in `lasting` and 1
    std::uint32_t look_ = 0;
    bool grounded_ = false;  // whether what bounces stays at the surface in this step
    ContactReport report_;
};

// Of cells whose corners, over the step, are not all on one side of the sphere's box; the links of a chain.
template <class Visit>
void FaceWork::each_near_triangle(int sphere, Visit visit) {
    const double reach = shells_[at(sphere)].near;
    const int rows = cloth_.rows, columns = cloth_.columns;
    const auto may_touch = [&](std::initializer_list<int> corners) {
        Vec3 low = start_[at(*corners.begin())], high = low;
        for (const int i : corners) {
            low = low.cwiseMin(start_[at(i)]).cwiseMin(end_[at(i)]);
            high = high.cwiseMax(start_[at(i)]).cwiseMax(end_[at(i)]);
        }
        return (low.array() < reach).all() && (high.array() > -reach).all();
    };
    if (rows == 1 || columns == 1) {
        for (int i = 0; i + 1 < cloth_.points(); ++i)
            if (may_touch({i, i + 1})) visit(Triangle{{i, i + 1, i + 1}, 2 * at(i)});
        return;
    }
    for (int r = 0; r + 1 < rows; ++r)
        for (int c = 0; c + 1 < columns; ++c) {
            const int i = r * columns + c, below = i + columns;
            if (!may_touch({i, i + 1, below, below + 1})) continue;
            visit(Triangle{{i, i + 1, below}, 2 * at(i)});
            visit(Triangle{{i + 1, below + 1, below}, 2 * at(i) + 1});
        }
}

}  // namespace clothsim
