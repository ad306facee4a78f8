// The engine of the "gather" kernel: padded structure of arrays, one tile a shader group.
#pragma once

#include <cstdlib>
#include <new>

#include "collision/response.hpp"
#include "simulation/engine.hpp"

namespace clothsim {

// Memory for SIMD: aligned to a cache line.
template <class T>
struct AlignedAllocator {
    using value_type = T;
    AlignedAllocator() = default;
    template <class U>
    AlignedAllocator(const AlignedAllocator<U>&) {}
    T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64))); }
    void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(64)); }
    friend bool operator==(const AlignedAllocator&, const AlignedAllocator&) { return true; }
};
template <class T>
using AlignedVector = std::vector<T, AlignedAllocator<T>>;

template <class Real>
class GatherEngine final : public Engine {
public:
    explicit GatherEngine(const Plan& plan);

    void load(const float* x, const float* v) override { load_any(x, v); }
    void load(const double* x, const double* v) override { load_any(x, v); }
    void store(float* x, float* v) const override { store_any(x, v); }
    void store(double* x, double* v) const override { store_any(x, v); }
    void advance(std::int64_t steps, const Clock& clock, int threads) override;
    void accelerations(double* a, int threads) override;
    std::int64_t first_non_finite() const override;
    std::vector<double> raw_state() const override;
    void set_raw_state(const std::vector<double>& raw) override;
    void save_checkpoint() override;
    void restore_checkpoint() override;

private:
    static constexpr bool compensated = sizeof(Real) == 4;

    std::ptrdiff_t at(int row, int column) const { return origin_ + row * stride_ + column; }
    template <class In>
    void load_any(const In* x, const In* v);
    template <class Out>
    void store_any(Out* x, Out* v) const;
    void build_coefficients();
    GatherArguments<Real> arguments(Stage stage, double dt);
    void collide(const Contact& contact, const Tile& tile);
    void answer(const Contact& contact, int row, int column);
    double spring_energy(int row, int column) const;
    PointState point_state(int row, int column) const;
    template <class Visit>
    void for_each_value(Visit visit);

    Plan plan_;
    ThreadGrid grid_;
    GatherKernel<Real> kernel_;
    SphereKernel<Real> sphere_kernel_;
    std::ptrdiff_t stride_, origin_, plane_;
    AlignedVector<Real> coefficients_, inverse_mass_, free_;
    SpringCoefficients<Real> spring_[neighbour_count];
    std::vector<std::uint8_t> row_has_fixed_;
    double coefficient_scale_ = 1;  // 1 / mass where the mass is uniform
    // Six planes each; compensation only where the arithmetic is single.
    AlignedVector<Real> state_, stage_a_, stage_b_, compensation_;
    AlignedVector<Real> first_acceleration_, acceleration_sum_;
    AlignedVector<Real> checkpoint_;
};

}  // namespace clothsim
