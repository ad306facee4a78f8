// The edge kernel's coefficients: springs, and forces on points, as the vectors of a row have them.
#include <cstring>
#include <map>
#include <optional>

#include "engines/edge_band.hpp"

namespace clothsim {

template <class Real>
void EdgeEngine<Real>::build_coefficients() {
    const Cloth& cloth = plan_.cloth;
    const double scale = coefficient_scale(plan_);
    const double root_scale = double(kernels().root_scale);
    const std::optional<double> shared = shared_damping<Real>(plan_);
    unit_ = shared.value_or(1);
    damped_alike_ = shared || !plan_.features().spring_damping;

    Real all_bits;
    std::memset(&all_bits, 0xff, sizeof all_bits);
    // Vectors whose lanes have the same springs share a class; there are few. The first has them all.
    std::map<std::vector<int>, int> classes;
    const auto class_of = [&](const std::vector<int>& reach) {
        const auto [found, is_new] = classes.try_emplace(reach, int(classes.size()));
        if (!is_new) return found->second;
        for (const Neighbour& neighbour : spring_kinds)
            for (const int what : {0, 1, 2})
                for (const int follow : reach) {
                    const bool there = follow >= neighbour.column;
                    const double stiffness = cloth.stiffness[neighbour.family] * scale / unit_;
                    const Real tension = Real(stiffness * cloth.rest_length(neighbour) / root_scale);
                    const double damping =
                        cloth.spring_damping[neighbour.family] * scale / (root_scale * root_scale) / unit_;
                    const Real value = what == EdgeCoefficientIndex::stiffness
                        ? stiffness_at_rest<Real>(plan_, neighbour, Real(stiffness), tension)
                        : what == EdgeCoefficientIndex::tension ? tension
                                                                : Real(damping);
                    coefficients_.push_back(there ? value : Real(0));
                }
        return found->second;
    };
    class_of(std::vector<int>(std::size_t(layout_.lanes), 2));
    for (int k = 0; k < layout_.vectors; ++k) {
        std::vector<int>
            reach;  // per lane, how many columns follow (2: enough for every spring), -1: padding
        for (int lane = 0; lane < layout_.lanes; ++lane)
            reach.push_back(std::clamp(layout_.window - 1 - (lane * layout_.vectors + k), -1, 2));
        coefficient_class_.push_back(std::uint8_t(class_of(reach)));
        for (const int columns : {1, 2})
            for (const int follow : reach) reach_.push_back(follow >= columns ? all_bits : Real(0));
    }
    whole_vectors_ = int(std::find_if(coefficient_class_.begin(), coefficient_class_.end(),
                                      [](std::uint8_t of_vector) { return of_vector != 0; }) -
                         coefficient_class_.begin());
    if (layout_.padded()) whole_vectors_ = std::min(whole_vectors_, layout_.vectors - 3);
}

// The kernel adds forces where it divides by masses, so that a cloth without either pays for neither.
template <class Real>
void EdgeEngine<Real>::apply_force() {
    const std::ptrdiff_t all_rows = layout_.strips * rows();
    if (applied_.empty()) {
        applied_.assign(3 * all_rows * layout_.width(), Real(0));
        if (inverse_mass_.empty()) inverse_mass_.assign(all_rows * layout_.width(), Real(1));
        bands_.clear();  // they point to both
    }
    for (std::ptrdiff_t row = 0; row < all_rows; ++row)
        layout_.for_each_column([&](int c, std::ptrdiff_t in_row) {
            const int point = int(row) % rows() * columns() + layout_.start(int(row) / rows()) + c;
            const Vec3 applied = this->applied_at(point) / unit_;
            const std::ptrdiff_t lanes = layout_.lanes, vector = in_row / lanes, lane = in_row % lanes;
            for (int j = 0; j < 3; ++j)
                applied_[3 * row * layout_.width() + (3 * vector + j) * lanes + lane] = Real(applied[j]);
        });
}

template void EdgeEngine<float>::build_coefficients();
template void EdgeEngine<double>::build_coefficients();
template void EdgeEngine<float>::apply_force();
template void EdgeEngine<double>::apply_force();

}  // namespace clothsim
