// Whether the user has asked for the end of a picture.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

namespace clothsim::picture {

class Poll {
public:
    explicit Poll(const std::function<bool()>& interrupted) : interrupted_(interrupted) {}

    // Only the thread that made this object asks, since `interrupted` enters Python.
    bool stopped() {
        if (std::this_thread::get_id() == asker_) {
            const auto now = Clock::now();
            if (now - asked_ >= period) {
                if (interrupted_()) stopped_.store(true, std::memory_order_relaxed);
                asked_ = Clock::now();
            }
        }
        return stopped_.load(std::memory_order_relaxed);
    }

private:
    using Clock = std::chrono::steady_clock;
    // A question takes 0.1 us, or 5 ms where another thread of Python holds the lock. At half, such a picture
    // would take twice its time; at twice, Ctrl-C would be late by 10 ms more.
    static constexpr std::chrono::milliseconds period{10};

    const std::function<bool()>& interrupted_;
    const std::thread::id asker_ = std::this_thread::get_id();
    Clock::time_point asked_ = Clock::now();
    std::atomic<bool> stopped_{false};
};

}  // namespace clothsim::picture
