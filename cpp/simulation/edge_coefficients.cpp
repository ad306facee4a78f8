// The edge kernel's coefficients: springs as the vectors of a row have them.
#include <map>

#include "simulation/edge_engine.hpp"

namespace clothsim {

template <class Real>
void EdgeEngine<Real>::build_coefficients() {
    const Cloth& cloth = plan_.cloth;
    const double scale = this->coefficient_scale();
    const double root_scale = double(kernels_of<Real>(*plan_.kernels).root_scale);
    constexpr struct {
        EdgeKind kind;
        Neighbour neighbour;
    } kinds[edge_kind_count] = {{to_right, {0, 1, structural}},
                                {to_right_2, {0, 2, bend}},
                                {to_below, {1, 0, structural}},
                                {to_diagonal, {1, 1, shear}},
                                {to_below_2, {2, 0, bend}}};

    // Damping that is the same for all families is taken out of the springs, which saves a product each.
    double most_damping = 0, most_stiffness = 0;
    for (int f = 0; f < family_count; ++f)
        if (cloth.present[f]) {
            most_damping = std::max(most_damping, cloth.spring_damping[f]);
            most_stiffness = std::max(most_stiffness, cloth.stiffness[f]);
        }
    bool alike = true;
    for (int f = 0; f < family_count; ++f) alike &= !cloth.present[f] || cloth.spring_damping[f] == most_damping;
    const double unit = most_damping * scale / (root_scale * root_scale);
    const bool damped = most_damping > 0;
    // A quotient of stiffness and damping that single cannot hold is not worth it.
    const bool fold = damped && alike && most_stiffness * scale <= 1e15 * unit && unit < 1e15;
    force_scale_ = fold ? unit : 1;
    complete_ = layout_.window == layout_.width() && (!damped || fold);

    // Vectors whose lanes have the same springs share a class; there are few. The first has them all.
    std::map<std::vector<int>, int> classes;
    const auto class_of = [&](const std::vector<int>& reach) {
        const auto [found, is_new] = classes.try_emplace(reach, int(classes.size()));
        if (!is_new) return found->second;
        for (const auto& [kind, neighbour] : kinds)
            for (const int what : {0, 1, 2})
                for (const int follow : reach) {
                    const bool there = follow >= neighbour.column;
                    const double stiffness = cloth.stiffness[neighbour.family] * scale / force_scale_;
                    const Real tension = Real(stiffness * cloth.rest_length(neighbour) / root_scale);
                    const double damping = cloth.spring_damping[neighbour.family] * scale / (root_scale * root_scale) / force_scale_;
                    const Real value = what == EdgeCoefficientIndex::stiffness ? this->stiffness_at_rest(neighbour, Real(stiffness), tension)
                                       : what == EdgeCoefficientIndex::tension ? tension
                                                                               : Real(damping);
                    coefficients_.push_back(there ? value : Real(0));
                }
        return found->second;
    };
    class_of(std::vector<int>(std::size_t(layout_.lanes), 2));
    for (int k = 0; k < layout_.vectors; ++k) {
        std::vector<int> reach;  // per lane, how many columns follow (2: enough for every spring), -1: padding
        for (int lane = 0; lane < layout_.lanes; ++lane)
            reach.push_back(std::clamp(layout_.window - 1 - (lane * layout_.vectors + k), -1, 2));
        coefficient_class_.push_back(std::uint8_t(class_of(reach)));
    }
    for (Real& value : scale_) value = Real(double(value) * force_scale_);
}

template void EdgeEngine<float>::build_coefficients();
template void EdgeEngine<double>::build_coefficients();

}  // namespace clothsim
