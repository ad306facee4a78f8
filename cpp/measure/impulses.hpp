// Impulses on the spheres: minus the momentum that their responses gave to the cloth, over all
// steps.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "model/scene.hpp"

namespace clothsim {

// A sphere has a sum for each group of `group_size` points of each row, shape (spheres, rows,
// groups, 3). One thread adds to a sum, in the order of the steps. So the sums have the same bits
// for any number of threads.
class Impulses {
public:
    Impulses() = default;
    explicit Impulses(const Scene& scene)
        : rows_(std::size_t(scene.cloth.rows)), groups_(groups_of(scene.cloth)) {
        sums_.assign(scene.spheres.size() * size_of_sphere(), 0.0);
    }
    static std::size_t groups_of(const Cloth& cloth) {
        return std::size_t((cloth.columns + group_size - 1) / group_size);
    }

    // The sphere gave a mass point that momentum [N s].
    void give(std::size_t sphere, int row, int column, const Vec3& momentum) {
        double* const sum = of_row(sphere, row) + 3 * (column / group_size);
        for (int k = 0; k < 3; ++k) sum[k] -= momentum[k];
    }
    // Returns the first sum of a row; `size_of_row` is the elements from a row to the next.
    double* of_row(std::size_t sphere, int row) {
        return sums_.data() + sphere * size_of_sphere() + std::size_t(row) * size_of_row();
    }
    std::size_t size_of_row() const { return 3 * groups_; }

    Vec3 on_sphere(std::size_t sphere) const {
        Vec3 all = Vec3::Zero();
        const double* sum = sums_.data() + sphere * size_of_sphere();
        for (std::size_t i = 0; i < rows_ * groups_; ++i, sum += 3)
            all += Vec3(sum[0], sum[1], sum[2]);
        return all;
    }
    void clear_counts() { std::fill(sums_.begin(), sums_.end(), 0.0); }
    const std::vector<double>& sums() const { return sums_; }
    // Go on from the sums of a cloth of this shape. Spheres that had none begin at 0.
    void continue_from(const std::vector<double>& sums) {
        clear_counts();
        std::copy_n(sums.begin(), std::min(sums.size(), sums_.size()), sums_.begin());
    }

private:
    std::size_t size_of_sphere() const { return rows_ * size_of_row(); }

    std::size_t rows_ = 0;
    std::size_t groups_ = 0;
    std::vector<double> sums_;
};

}  // namespace clothsim
