// The broad phase of the pass for faces: which triangles have to be inspected for a touch with a sphere.
//
//        triangle at the start     at the end         A plane stands between triangle and sphere, and turns
//            \                        \               from its place at the start to that at the end. If all
//             \   |                    \  /           corners keep behind it, the triangle stays clear.
//              \  |   __                \/  __
//                 | /    \              / /    \      The plane of the last inspection often serves again, as
//                 | \ S  /             /  \ S  /      cloth moves little in a step.
//
// The heights of all triangles above their planes are computed at once, when a step begins (first). In later
// rounds a height has fallen by no more than corners have moved since (drift), so few planes are tested.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "contact/triangle.hpp"
#include "kernels/contact/face_kernels.hpp"
#include "model/cloth.hpp"

namespace clothsim {

inline std::size_t at(int i) { return std::size_t(i); }

class FaceBroadPhase {
public:
    struct Triangle {
        std::array<int, 3> corner;
        std::size_t number;
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
    // The triangles of a pass: all, as a step begins; those that have moved or touched; all again.
    enum class Pass { first, moved, all };

    FaceBroadPhase(const Cloth& cloth, std::size_t spheres, const FaceKernels& kernels);

    // Positions when the step begins, seen from a sphere's centre.
    void begin(int sphere, const double (&center)[3], const std::vector<Vec3>& x);
    // Positions where the step ends now, likewise.
    const Frame& place(int sphere, const double (&center)[3], const std::vector<Vec3>& x);
    const Frame& frame(int sphere) const { return frames_[at(sphere)]; }

    // Notes the points that have moved by more than `slack` [m] since they were noted, or all of them.
    void note_all_moved(const std::vector<Vec3>& x);
    void note_moves(const std::vector<Vec3>& x, double slack);
    // Notes how far each row of points is from where the free step ended.
    void note_drift(const std::vector<Vec3>& x, const std::vector<Vec3>& free_x);
    // Notes the numbers of the triangles that touch a sphere, in place of those noted before.
    void note_touches(int sphere, std::vector<std::size_t> touching);
    void set_plane(int sphere, const Triangle& triangle, const TriangleTouch& touch);

    // Whether the triangle keeps beyond its plane, at distance `reach` from the centre, throughout.
    bool separated(int sphere, const Triangle& triangle, double reach) const;
    // Triangles that no plane proves clear, beyond that distance from the centre; links of a chain.
    template <class Visit>
    void each_open(int sphere, double reach, Pass pass, Visit visit);

private:
    CellRow cell_row(const Frame& frame, int first) const;
    bool has_moved(int sphere, const Triangle& t) const {
        return moved_[at(t.corner[0])] | moved_[at(t.corner[1])] | moved_[at(t.corner[2])] |
            touching_[at(sphere)][t.number];
    }

    const Cloth& cloth_;
    const FaceKernels& kernels_;
    std::vector<Frame> frames_;
    std::vector<double> drift_;  // of rows of points: the farthest of a point [m]
    std::vector<Vec3> noted_x_;
    std::vector<std::uint8_t> moved_;
    std::vector<std::vector<std::uint8_t>> touching_;  // triangles
    std::vector<std::vector<std::size_t>> touching_list_;
};

template <class Visit>
void FaceBroadPhase::each_open(int sphere, double reach, Pass pass, Visit visit) {
    const int rows = cloth_.rows, columns = cloth_.columns;
    if (rows == 1 || columns == 1) {
        for (int i = 0; i + 1 < cloth_.points(); ++i) {
            const Triangle t{{i, i + 1, i + 1}, 2 * at(i)};
            if (!separated(sphere, t, reach)) visit(t);
        }
        return;
    }
    Frame& frame = frames_[at(sphere)];
    const bool first = pass == Pass::first;
    const auto open = [&](const Triangle& t) {
        return first || ((pass == Pass::all || has_moved(sphere, t)) && !separated(sphere, t, reach));
    };
    for (int r = 0; r + 1 < rows; ++r) {
        const int begin = r * columns;
        double *const upper = frame.heights[0].data() + begin, *const lower = frame.heights[1].data() + begin;
        if (first) kernels_.heights(cell_row(frame, begin), upper, lower);
        const double enough = first ? reach : reach + std::max(drift_[at(r)], drift_[at(r + 1)]);
        for (int c = 0; c + 1 < columns; ++c) {
            const int i = begin + c, below = i + columns;
            const Triangle one{{i, i + 1, below}, 2 * at(i)}, other{{i + 1, below + 1, below}, 2 * at(i) + 1};
            if (!(upper[c] > enough) && open(one)) visit(one);
            if (!(lower[c] > enough) && open(other)) visit(other);
        }
    }
}

}  // namespace clothsim
