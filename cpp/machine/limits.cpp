#include "machine/limits.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <optional>
#include <vector>

#include "memory/threads.hpp"

namespace clothsim {
namespace {

using Clock = std::chrono::steady_clock;
// Windows of a measurement, of which the best counts, and the seconds of each. Half of either has fewer quiet
// moments of a shared machine; twice only takes longer.
constexpr int windows = 8;
constexpr double window_seconds = 0.01;
constexpr std::ptrdiff_t cache_line = 64;  // bytes, on all processors with kernels

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

// The best rate of `threads` threads that each do `work`, which returns how much it did.
template <class Work>
double best_rate(int threads, Work work) {
    double best = 0;
    for (int window = 0; window < windows; ++window) {
        std::vector<double> rates(std::size_t(threads), 0);
        std::optional<Barrier> barrier;
        in_team(
            threads, [&](int team) { barrier.emplace(team); },
            [&](int thread, int) {
                work(thread);  // touches the data and raises the clock
                barrier->wait();
                const auto start = Clock::now();
                double done = 0, seconds = 0;
                do {
                    done += work(thread);
                    seconds = seconds_since(start);
                } while (seconds < window_seconds);
                rates[std::size_t(thread)] = done / seconds;
            });
        best = std::max(best, std::accumulate(rates.begin(), rates.end(), 0.0));
    }
    return best;
}

template <class Real>
class Buffer {
public:
    explicit Buffer(std::ptrdiff_t n)
        : data_(static_cast<Real*>(::operator new(n * sizeof(Real), std::align_val_t(cache_line)))) {
        std::fill_n(data_.get(), n, Real(1));
    }
    Real* data() { return data_.get(); }

private:
    struct Free {
        void operator()(Real* p) const { ::operator delete(p, std::align_val_t(cache_line)); }
    };
    std::unique_ptr<Real, Free> data_;
};

}  // namespace

template <class Real>
double multiply_add_peak(const KernelTable& kernels, int threads) {
    const LimitKernels<Real>& limits = kernels_of<Real>(kernels).limits;
    // Some 50 us, so that reading the clock costs nothing; half or twice does not either.
    constexpr std::int64_t rounds = 4096;
    return best_rate(threads, [&](int) {
        limits.multiply_add(rounds);
        return double(rounds) * limits.flops_per_round;
    });
}

template <class Real>
Bandwidth memory_bandwidth(const KernelTable& kernels, int threads, std::int64_t bytes) {
    const LimitKernels<Real>& limits = kernels_of<Real>(kernels).limits;
    constexpr std::ptrdiff_t line = cache_line / sizeof(Real);
    const std::ptrdiff_t n = std::max<std::ptrdiff_t>(1, bytes / threads / (3 * cache_line)) * line;
    std::vector<std::unique_ptr<Buffer<Real>>> buffers(threads);
    // First touched by the thread that uses them, so that they lie in its memory.
    in_team(threads, [&](int thread, int) { buffers[thread] = std::make_unique<Buffer<Real>>(3 * n); });
    const auto triad = [&](int thread) {
        Real* const a = buffers[thread]->data();
        limits.triad(a, a + n, a + 2 * n, n);
        return 3.0 * n * sizeof(Real);
    };
    const auto update = [&](int thread) {
        limits.update(buffers[thread]->data(), 3 * n);
        return 2.0 * 3 * n * sizeof(Real);
    };
    return {best_rate(threads, update), best_rate(threads, triad)};
}

double core_round_trip() {
    constexpr int trips = 2000;  // 0.2 ms or more, far above the resolution of the clock at half too
    struct alignas(2 * cache_line) Flag {
        std::atomic<int> value{0};
    } ping, pong;
    double best = std::numeric_limits<double>::infinity();
    for (int window = 0; window < windows; ++window) {
        ping.value = pong.value = 0;
        in_team(2, [&](int thread, int team) {
            if (thread == 1) {
                for (int i = 1; i <= trips; ++i) {
                    while (ping.value.load(std::memory_order_acquire) != i) {
                    }
                    pong.value.store(i, std::memory_order_release);
                }
            } else if (team == 2) {
                const auto start = Clock::now();
                for (int i = 1; i <= trips; ++i) {
                    ping.value.store(i, std::memory_order_release);
                    while (pong.value.load(std::memory_order_acquire) != i) {
                    }
                }
                best = std::min(best, seconds_since(start) / trips);
            }
        });
    }
    return best;
}

template double multiply_add_peak<float>(const KernelTable&, int);
template double multiply_add_peak<double>(const KernelTable&, int);
template Bandwidth memory_bandwidth<float>(const KernelTable&, int, std::int64_t);
template Bandwidth memory_bandwidth<double>(const KernelTable&, int, std::int64_t);

}  // namespace clothsim
