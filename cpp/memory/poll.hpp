// Asks in the middle of long work whether the user wants it to end.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

#include "memory/heuristics.hpp"

namespace clothsim {

class Poll {
public:
    explicit Poll(const std::function<bool()>& interrupted) : interrupted_(interrupted) {}

    bool stopped() {
        return is_asker() ? stopped(std::chrono::steady_clock::now())
                          : stopped_.load(std::memory_order_relaxed);
    }
    // The thread that made this object calls it. Only that thread asks, since `interrupted` enters
    // Python.
    bool stopped(std::chrono::steady_clock::time_point now) {
        if (now - asked_ >= heuristics::time_between_questions &&
            !stopped_.load(std::memory_order_relaxed)) {
            if (interrupted_()) stopped_.store(true, std::memory_order_relaxed);
            asked_ = std::chrono::steady_clock::now();
        }
        return stopped_.load(std::memory_order_relaxed);
    }
    bool is_asker() const { return std::this_thread::get_id() == asker_; }
    std::chrono::steady_clock::time_point last_question() const { return asked_; }

private:
    const std::function<bool()>& interrupted_;
    const std::thread::id asker_ = std::this_thread::get_id();
    std::chrono::steady_clock::time_point asked_ = std::chrono::steady_clock::now();
    std::atomic<bool> stopped_{false};
};

}  // namespace clothsim
