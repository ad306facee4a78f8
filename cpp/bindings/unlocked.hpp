// The lock of the interpreter, released while the core works. Subnormal numbers are zero there, and only
// there.
#pragma once

#include <chrono>
#include <optional>
#include <thread>

#include "bindings/bindings.hpp"
#include "memory/subnormals.hpp"

namespace clothsim {

// A daemon thread may be in the core when the interpreter ends. Where it takes the lock again, Python before
// 3.14 unwinds its stack to end the thread. That stops at the first destructor and aborts the process.
// So the thread sleeps until the process ends, with all that its frames own.
class Unlocked {
public:
    Unlocked() : thread_(PyEval_SaveThread()) {}
    ~Unlocked() { lock(); }
    Unlocked(const Unlocked&) = delete;
    Unlocked& operator=(const Unlocked&) = delete;

    // Whether a signal, such as that of Ctrl-C, has raised an exception.
    bool signal_pending() {
        lock();
        const bool pending = PyErr_CheckSignals() != 0;
        thread_ = PyEval_SaveThread();
        flushed_.emplace();
        return pending;
    }

private:
    void lock() noexcept {
        flushed_.reset();
        try {
            PyEval_RestoreThread(thread_);
        } catch (...) {  // the unwinding; to leave this block is not allowed
            for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
        }
    }

    PyThreadState* thread_;
    std::optional<FlushSubnormals> flushed_{std::in_place};
};

}  // namespace clothsim
