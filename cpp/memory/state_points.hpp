// The mass points of a state that lies in an engine's layout, with what compensation adds to
// single.
#pragma once

#include <cstddef>

#include "lanes/aligned_vector.hpp"
#include "model/motion.hpp"

namespace clothsim {

struct PointState {
    Vec3 position;
    Vec3 velocity;

    bool operator==(const PointState&) const = default;
};

// A Layout says where component k (x, y, z, vx, vy, vz) of the mass point (row, column) lies:
// `at(row, column, k)`; compensation lies `compensation()` elements further.
template <class Real, class Layout>
class StatePoints {
public:
    static constexpr bool compensated = sizeof(Real) == 4;
    using State = AlignedVector<Real>;

    StatePoints(const Layout& layout, int columns) : layout_(layout), columns_(columns) {}

    std::ptrdiff_t place(int point, int k) const {
        return layout_.at(point / columns_, point % columns_, k);
    }
    double value(const State& state, std::ptrdiff_t at) const {
        if constexpr (compensated)
            return double(state[std::size_t(at)]) +
                double(state[std::size_t(at + layout_.compensation())]);
        else return state[std::size_t(at)];
    }
    void set_value(State& state, std::ptrdiff_t at, double value) const {
        Real& high = state[std::size_t(at)] = Real(value);
        if constexpr (compensated)
            state[std::size_t(at + layout_.compensation())] = Real(value - double(high));
    }
    Vec3 position(const State& state, int point) const { return vector(state, point, 0); }
    Vec3 velocity(const State& state, int point) const { return vector(state, point, 3); }
    PointState get(const State& state, int point) const {
        return {position(state, point), velocity(state, point)};
    }
    void set_velocity(State& state, int point, const Vec3& velocity) const {
        for (int k = 0; k < 3; ++k) set_value(state, place(point, k + 3), velocity[k]);
    }
    void set_position(State& state, int point, const Vec3& position) const {
        for (int k = 0; k < 3; ++k) set_value(state, place(point, k), position[k]);
    }
    void set(State& state, int point, const PointState& to) const {
        set_position(state, point, to.position);
        set_velocity(state, point, to.velocity);
    }

private:
    Vec3 vector(const State& state, int point, int first) const {
        const auto component = [&](int k) { return value(state, place(point, first + k)); };
        return {component(0), component(1), component(2)};
    }

    const Layout& layout_;
    int columns_;
};

}  // namespace clothsim
