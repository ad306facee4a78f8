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
    FaceWork(const Cloth& cloth, const Vec3& gravity, const std::vector<bool>& faces, const FaceKernels& kernels);
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
    // Of a sphere: where the points are seen from it, as columns of x, y and z; of each triangle the directions of a plane between
    // the two, at the start and at the end.
    struct Frame {
        std::array<std::vector<double>, 3> start, end;
        std::array<std::array<std::vector<double>, 6>, 2> planes;  // of the triangles 2 i and 2 i + 1

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
        double arrival = 0;  // normal speed with which it comes to the surface [m/s]
        double height = 0;   // above the surface that it reaches by the end of the step [m]
    };

    // How a projection works: rounds of new rows, and sweeps over the rows of each.
    struct Sweeps {
        int rounds, most;
    };
    static constexpr int most_rounds = 24;
    static constexpr Sweeps all_sweeps{30, 100}, single_sweeps{400, 1};

    Corners corners(const std::vector<Vec3>& of, const std::array<int, 3>& corner) const;
    template <class Visit>
    void each_open_triangle(int sphere, double reach, Visit visit, bool moved_alone = false);
    static void place(const std::vector<Vec3>& from, const double (&center)[3], std::array<std::vector<double>, 3>& to);
    Frame& place_in_frame(int sphere);
    void set_plane(int sphere, const Triangle& triangle, const TriangleTouch& touch);
    void note_moves(int round);
    void note_rows_to_look_at(int sphere);
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
    bool project(const Sweeps& sweeps);
    bool place_rows();
    bool search();
    std::vector<std::vector<Vec3>> starts() const;
    int left_over();
    void ground();
    bool follow_ways(int first_round);
    bool restore_speeds();
    bool bounced() const;
    double energy_lacking() const;
    double elastic_change() const;
    void push_out_all();
    bool push_out(int sphere, const Triangle& triangle);
    void note_changed();
    int pinned_corner(const std::array<int, 3>& corner) const;

    const Cloth& cloth_;
    Vec3 gravity_;
    std::vector<bool> faces_;
    const std::vector<SweptSphere>* spheres_ = nullptr;
    std::vector<Shell> shells_;
    const FaceKernels& kernels_;
    std::vector<Frame> frames_;
    std::vector<double> heights_;          // of a row of cells
    std::vector<Vec3> scratch_;            // of points
    std::vector<Vec3> free_x_, free_v_;    // where the free step ended
    std::vector<ContactRow> rows_;
    std::vector<Origin> origins_;
    std::vector<Vec3> looked_x_;                         // x as it was when a point's triangles were looked at
    std::vector<std::uint8_t> moved_;                    // points that have left it
    std::vector<std::uint8_t> look_again_;               // rows of cells with a triangle that `has_moved`
    std::vector<std::vector<std::uint8_t>> reached_;     // triangles for which the look before found something
    std::vector<std::vector<std::size_t>> reached_list_;
    SolverMemory memory_;
    std::vector<double> sum_;
    std::vector<double> pushed_;
    std::vector<std::vector<std::uint8_t>> inside_;      // triangles, points that were inside when the step began
    std::vector<std::pair<int, Triangle>> starts_inside_;
    std::vector<std::uint32_t> seen_;                    // features: in which look they got a row
    std::vector<std::uint32_t> lasted_;                  // features: place in `lasting` and 1
    std::uint32_t look_ = 0;
    bool grounded_ = false;  // whether what bounces stays at the surface in this step
    ContactReport report_;
};

// Triangles whose planes do not prove them clear, beyond that distance from the centre; the links of a chain. `moved_alone`: of
// rows of cells in which something has moved.
template <class Visit>
void FaceWork::each_open_triangle(int sphere, double reach, Visit visit, bool moved_alone) {
    const int rows = cloth_.rows, columns = cloth_.columns;
    if (rows == 1 || columns == 1) {
        for (int i = 0; i + 1 < cloth_.points(); ++i) {
            const Triangle t{{i, i + 1, i + 1}, 2 * at(i)};
            if (!separated(sphere, t, reach)) visit(t);
        }
        return;
    }
    const Frame& frame = frames_[at(sphere)];
    double* const heights = heights_.data();
    for (int r = 0; r + 1 < rows; ++r) {
        if (moved_alone && !look_again_[at(r)]) continue;
        const int first = r * columns;
        CellRow row;
        row.cells = columns - 1;
        for (std::size_t k = 0; k < 3; ++k) {
            row.start[k] = frame.start[k].data() + first;
            row.end[k] = frame.end[k].data() + first;
            row.start_below[k] = row.start[k] + columns;
            row.end_below[k] = row.end[k] + columns;
        }
        for (std::size_t t = 0; t < 2; ++t)
            for (std::size_t k = 0; k < 6; ++k) row.planes[t][k] = frame.planes[t][k].data() + first;
        kernels_.heights(row, heights, heights + columns);
        for (int c = 0; c + 1 < columns; ++c) {
            const int i = first + c, below = i + columns;
            if (!(heights[c] > reach)) visit(Triangle{{i, i + 1, below}, 2 * at(i)});
            if (!(heights[columns + c] > reach)) visit(Triangle{{i + 1, below + 1, below}, 2 * at(i) + 1});
        }
    }
}

}  // namespace clothsim
