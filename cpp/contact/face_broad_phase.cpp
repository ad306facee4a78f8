#include "contact/face_broad_phase.hpp"

#include <algorithm>
#include <cmath>

namespace clothsim {
namespace {

void place_points(const std::vector<Vec3>& from, const double (&center)[3],
                  std::array<std::vector<double>, 3>& to) {
    for (std::size_t k = 0; k < 3; ++k) {
        double* const out = to[k].data();
        for (std::size_t i = 0; i < from.size(); ++i) out[i] = from[i][Eigen::Index(k)] - center[k];
    }
}

}  // namespace

FaceBroadPhase::FaceBroadPhase(const Cloth& cloth, std::size_t spheres, const FaceKernels& kernels)
    : cloth_(cloth), kernels_(kernels), frames_(spheres), drift_(at(cloth.rows)) {
    const std::size_t n = at(cloth.points());
    for (Frame& frame : frames_) {
        for (std::size_t k = 0; k < 3; ++k) {
            frame.start[k].resize(n);
            frame.end[k].resize(n);
        }
        for (auto& heights : frame.heights) heights.resize(n);
        for (auto& of_triangle : frame.planes)
            for (std::size_t k = 0; k < 6; ++k) of_triangle[k].assign(n, k % 3 == 1 ? 1.0 : 0.0);
    }
    moved_.resize(n);
    touching_.assign(spheres, std::vector<std::uint8_t>(2 * n, 0));
    touching_list_.resize(spheres);
}

void FaceBroadPhase::begin(int sphere, const double (&center)[3], const std::vector<Vec3>& x) {
    place_points(x, center, frames_[at(sphere)].start);
}

const FaceBroadPhase::Frame& FaceBroadPhase::place(int sphere, const double (&center)[3],
                                                   const std::vector<Vec3>& x) {
    Frame& frame = frames_[at(sphere)];
    place_points(x, center, frame.end);
    return frame;
}

CellRow FaceBroadPhase::cell_row(const Frame& frame, int first) const {
    CellRow row;
    row.cells = cloth_.columns - 1;
    for (std::size_t k = 0; k < 3; ++k) {
        row.start[k] = frame.start[k].data() + first;
        row.end[k] = frame.end[k].data() + first;
        row.start_below[k] = row.start[k] + cloth_.columns;
        row.end_below[k] = row.end[k] + cloth_.columns;
    }
    for (std::size_t t = 0; t < 2; ++t)
        for (std::size_t k = 0; k < 6; ++k) row.planes[t][k] = frame.planes[t][k].data() + first;
    return row;
}

void FaceBroadPhase::note_all_moved(const std::vector<Vec3>& x) {
    noted_x_ = x;
    std::fill(moved_.begin(), moved_.end(), std::uint8_t(1));
}

void FaceBroadPhase::note_moves(const std::vector<Vec3>& x, double slack) {
    for (std::size_t i = 0; i < x.size(); ++i) {
        moved_[i] = (x[i] - noted_x_[i]).squaredNorm() > slack * slack;
        if (moved_[i]) noted_x_[i] = x[i];
    }
}

void FaceBroadPhase::note_drift(const std::vector<Vec3>& x, const std::vector<Vec3>& free_x) {
    for (int r = 0; r < cloth_.rows; ++r) {
        double farthest2 = 0;
        for (int i = r * cloth_.columns; i < (r + 1) * cloth_.columns; ++i)
            farthest2 = std::max(farthest2, (x[at(i)] - free_x[at(i)]).squaredNorm());
        drift_[at(r)] = std::sqrt(farthest2);
    }
}

void FaceBroadPhase::note_touches(int sphere, std::vector<std::size_t> touching) {
    for (const std::size_t t : touching_list_[at(sphere)]) touching_[at(sphere)][t] = 0;
    for (const std::size_t t : touching) touching_[at(sphere)][t] = 1;
    touching_list_[at(sphere)] = std::move(touching);
}

void FaceBroadPhase::set_plane(int sphere, const Triangle& t, const TriangleTouch& touch) {
    auto& planes = frames_[at(sphere)].planes[t.number % 2];
    for (std::size_t k = 0; k < 3; ++k) {
        planes[k][t.number / 2] = touch.first_normal[Eigen::Index(k)];
        planes[3 + k][t.number / 2] = touch.normal[Eigen::Index(k)];
    }
}

bool FaceBroadPhase::separated(int sphere, const Triangle& t, double reach) const {
    const Frame& frame = frames_[at(sphere)];
    const auto& of = frame.planes[t.number % 2];
    const std::size_t i = t.number / 2;
    return beyond_turning_plane(Frame::corners(frame.start, t.corner), Frame::corners(frame.end, t.corner),
                                {of[0][i], of[1][i], of[2][i]}, {of[3][i], of[4][i], of[5][i]}, reach);
}

}  // namespace clothsim
