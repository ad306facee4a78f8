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
    using Memory = AlignedVector<Real>;

    StatePoints(const Layout& layout, int columns) : layout_(layout), columns_(columns) {}

    std::ptrdiff_t place(int point, int k) const {
        return layout_.at(point / columns_, point % columns_, k);
    }
    double value(const Memory& memory, std::ptrdiff_t at) const {
        if constexpr (compensated)
            return double(memory[std::size_t(at)]) +
                double(memory[std::size_t(at + layout_.compensation())]);
        else return memory[std::size_t(at)];
    }
    void set_value(Memory& memory, std::ptrdiff_t at, double value) const {
        Real& high = memory[std::size_t(at)] = Real(value);
        if constexpr (compensated)
            memory[std::size_t(at + layout_.compensation())] = Real(value - double(high));
    }
    Vec3 position(const Memory& memory, int point) const { return vector(memory, point, 0); }
    Vec3 velocity(const Memory& memory, int point) const { return vector(memory, point, 3); }
    PointState get(const Memory& memory, int point) const {
        return {position(memory, point), velocity(memory, point)};
    }
    void set_velocity(Memory& memory, int point, const Vec3& velocity) const {
        for (int k = 0; k < 3; ++k) set_value(memory, place(point, k + 3), velocity[k]);
    }
    void set_position(Memory& memory, int point, const Vec3& position) const {
        for (int k = 0; k < 3; ++k) set_value(memory, place(point, k), position[k]);
    }
    void set(Memory& memory, int point, const PointState& to) const {
        set_position(memory, point, to.position);
        set_velocity(memory, point, to.velocity);
    }

private:
    Vec3 vector(const Memory& memory, int point, int first) const {
        const auto component = [&](int k) { return value(memory, place(point, first + k)); };
        return {component(0), component(1), component(2)};
    }

    const Layout& layout_;
    int columns_;
};

}  // namespace clothsim
