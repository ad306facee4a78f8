#include "integrators/combine.hpp"

#include "memory/versions.hpp"

#define CLOTHSIM_INLINE inline __attribute__((always_inline))

namespace clothsim {
namespace {

// `bytes` of elements as the compiler's own vector: registers, or parts of one, of whatever the processor
// has.
template <class Real, int bytes>
struct Vector {
    typedef Real Type __attribute__((vector_size(bytes)));
    typedef Real Unaligned __attribute__((vector_size(bytes), aligned(sizeof(Real)), may_alias));
    static constexpr int size = bytes / int(sizeof(Real));
};

// A block of `count` vectors, in registers while accelerations are added.
template <class Real, int bytes, int count>
struct Block {
    using V = Vector<Real, bytes>;
    static constexpr int size = count * V::size;
    typename V::Type part[count];

    static CLOTHSIM_INLINE Block load(const Real* p) {
        Block b;
        for (int i = 0; i < count; ++i)
            b.part[i] = *reinterpret_cast<const typename V::Unaligned*>(p + i * V::size);
        return b;
    }
    CLOTHSIM_INLINE void store(Real* p) const {
        for (int i = 0; i < count; ++i) *reinterpret_cast<typename V::Unaligned*>(p + i * V::size) = part[i];
    }
    friend CLOTHSIM_INLINE Block operator+(Block a, const Block& b) {
        for (int i = 0; i < count; ++i) a.part[i] += b.part[i];
        return a;
    }
    friend CLOTHSIM_INLINE Block operator-(Block a, const Block& b) {
        for (int i = 0; i < count; ++i) a.part[i] -= b.part[i];
        return a;
    }
    friend CLOTHSIM_INLINE Block operator*(Real a, Block b) {
        for (int i = 0; i < count; ++i) b.part[i] = a * b.part[i];
        return b;
    }
};

// `work(row, where in the state, dx, dv)` for every block of the rows; `from` gives the velocities of the
// drift.
template <class B, class Real, class Work>
CLOTHSIM_INLINE void for_each_block(const FieldLayout& f, int begin, int end, const Real* from,
                                    const Combination<Real>& sum, Work work) {
    for (int r = begin; r < end; ++r)
        for (int k = 0; k < f.runs; ++k)
            for (int o = 0; o < f.length; o += B::size) {
                const std::ptrdiff_t state = f.origin + r * f.row + k * f.run + o;
                const std::ptrdiff_t at =
                    f.acceleration_origin + r * f.acceleration_row + k * f.acceleration_run + o;
                B dx = sum.drift * B::load(from + state + f.velocity), dv = Real(0) * dx;
                for (int l = 0; l < sum.count; ++l) {
                    const B a = B::load(sum.a[std::size_t(l)] + at);
                    dx = dx + sum.x[std::size_t(l)] * a;
                    dv = dv + sum.v[std::size_t(l)] * a;
                }
                work(r, state, dx, dv);
            }
}

// Kahan's compensated summation, as in the kernels.
template <class B, class Real>
CLOTHSIM_INLINE void add(const Real* value, Real* result, std::ptrdiff_t compensation, const B& increment) {
    const B old = B::load(value);
    if (compensation == 0) {
        (old + increment).store(result);
        return;
    }
    const B all = increment + B::load(value + compensation);
    const B next = old + all;
    (all - (next - old)).store(result + compensation);
    next.store(result);
}

// Calls `work` with the block type that divides the runs of the field. A run is three vectors of the edge
// kernel's lanes or, in the gather kernel, a multiple of 16 elements.
template <class Real, class Work>
CLOTHSIM_INLINE void with_blocks(const FieldLayout& f, Work work) {
    switch (f.length * int(sizeof(Real))) {
        case 3 * 64: return work(Block<Real, 64, 3>{});
        case 3 * 32: return work(Block<Real, 32, 3>{});
        case 3 * 16: return work(Block<Real, 16, 3>{});
        default: return work(Block<Real, 64, 1>{});
    }
}

template <class Real>
CLOTHSIM_INLINE void advance_any(const FieldLayout& f, int begin, int end, const Real* from, Real* to,
                                 const Combination<Real>& sum) {
    with_blocks<Real>(f, [&](auto block) __attribute__((always_inline)) {
        using B = decltype(block);
        for_each_block<B>(f, begin, end, from, sum,
                          [&](int, std::ptrdiff_t at, const B& dx, const B& dv)
                              __attribute__((always_inline)) {
                                  add(from + at, to + at, f.compensation, dx);
                                  add(from + at + f.velocity, to + at + f.velocity, f.compensation, dv);
                              });
    });
}

// `state` is any: nothing drifts.
template <class Real>
CLOTHSIM_INLINE void square_any(const FieldLayout& f, int begin, int end, const Real* state,
                                const Combination<Real>& sum, RowSquares* rows) {
    with_blocks<Real>(f, [&](auto block) __attribute__((always_inline)) {
        using B = decltype(block);
        for (int r = begin; r < end; ++r) {
            B total_x{}, total_v{};
            for_each_block<B>(f, r, r + 1, state, sum,
                              [&](int, std::ptrdiff_t, const B& dx, const B& dv)
                                  __attribute__((always_inline)) {
                                      for (std::size_t i = 0; i < sizeof(dx.part) / sizeof(dx.part[0]); ++i) {
                                          total_x.part[i] += dx.part[i] * dx.part[i];
                                          total_v.part[i] += dv.part[i] * dv.part[i];
                                      }
                                  });
            Real x[B::size], v[B::size];
            total_x.store(x);
            total_v.store(v);
            rows[r] = {};
            for (int i = 0; i < B::size; ++i) {
                rows[r].x += double(x[i]);
                rows[r].v += double(v[i]);
            }
        }
    });
}

}  // namespace

#define CLOTHSIM_ROWS(Real) \
    namespace { \
    CLOTHSIM_VERSIONS void advance_versions(const FieldLayout& field, int begin, int end, const Real* from, \
                                            Real* to, const Combination<Real>& sum) { \
        advance_any(field, begin, end, from, to, sum); \
    } \
    CLOTHSIM_VERSIONS void square_versions(const FieldLayout& field, int begin, int end, const Real* state, \
                                           const Combination<Real>& sum, RowSquares* rows) { \
        square_any(field, begin, end, state, sum, rows); \
    } \
    } \
    void advance_rows(const FieldLayout& field, int begin, int end, const Real* from, Real* to, \
                      const Combination<Real>& sum) { \
        advance_versions(field, begin, end, from, to, sum); \
    } \
    void square_rows(const FieldLayout& field, int begin, int end, const Real* state, \
                     const Combination<Real>& sum, RowSquares* rows) { \
        square_versions(field, begin, end, state, sum, rows); \
    }
CLOTHSIM_ROWS(float)
CLOTHSIM_ROWS(double)
#undef CLOTHSIM_ROWS

}  // namespace clothsim
