// Whether the user has asked for the end, asked in the middle of long work.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

namespace clothsim {

class Poll {
public:
    using Clock = std::chrono::steady_clock;

    explicit Poll(const std::function<bool()>& interrupted) : interrupted_(interrupted) {}

    bool stopped() {
        return is_asker() ? stopped(Clock::now()) : stopped_.load(std::memory_order_relaxed);
    }
    // For the thread that made this object. Only that thread asks, since `interrupted` enters
    // Python.
    bool stopped(Clock::time_point now) {
        if (now - asked_ >= period && !stopped_.load(std::memory_order_relaxed)) {
            if (interrupted_()) stopped_.store(true, std::memory_order_relaxed);
            asked_ = Clock::now();
        }
        return stopped_.load(std::memory_order_relaxed);
    }
    bool is_asker() const { return std::this_thread::get_id() == asker_; }
    Clock::time_point asked() const { return asked_; }

private:
    // A question takes 0.1 us, or 5 ms where another thread of Python holds the lock. At half, a
    // picture would take twice its time there; at twice, Ctrl-C would be late by 10 ms more.
    static constexpr std::chrono::milliseconds period{10};

    const std::function<bool()>& interrupted_;
    const std::thread::id asker_ = std::this_thread::get_id();
    Clock::time_point asked_ = Clock::now();
    std::atomic<bool> stopped_{false};
};

}  // namespace clothsim
