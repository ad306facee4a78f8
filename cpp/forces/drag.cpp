// Drag: - c v on each mass point. Values: c [N s/m]. The kernels compute it.
#include <algorithm>

#include "model/force.hpp"

namespace clothsim {
namespace {

class Drag final : public Force {
public:
    using Force::Force;

    void act(const Cloth& cloth, const ForceState& state, int begin, int end,
             double* force) const override {
        for (int k = 3 * begin * cloth.columns; k < 3 * end * cloth.columns; ++k)
            force[k] = -values[0] * state.v[k];
    }
    bool in_kernels() const override { return true; }
    double damping_bound(const Cloth& cloth, double) const override {
        return values[0] * cloth.largest_mobility();
    }
    void each_damping(const Cloth& cloth, const ForceState&, const AddBlock& add) const override {
        for (int i = 0; i < cloth.points(); ++i) add(i, i, values[0] * Eigen::Matrix3d::Identity());
    }
};

}  // namespace

std::shared_ptr<const Force> make_drag(std::string name, std::vector<double> values,
                                       Motion motion) {
    return std::make_shared<Drag>(std::move(name), std::move(values), std::move(motion));
}

}  // namespace clothsim
