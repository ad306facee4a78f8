// The lock of the interpreter, released while the core works. Subnormal numbers are zero there, and
// only there.
#pragma once

#include <optional>
#include <utility>

#include "bindings/bindings.hpp"
#include "memory/subnormals.hpp"

namespace clothsim {

// A daemon thread may be in the core when the interpreter ends. Where it takes the lock again,
// Python before 3.14 ends the thread, which must not destroy what its frames own: it stays here
// until the process ends.
void take_lock(PyThreadState* thread);

class Unlocked {
public:
    Unlocked() : thread_(PyEval_SaveThread()), outer_(std::exchange(innermost(), this)) {}
    ~Unlocked() {
        innermost() = outer_;
        lock();
    }
    Unlocked(const Unlocked&) = delete;
    Unlocked& operator=(const Unlocked&) = delete;

    // Whether a signal, such as that of Ctrl-C, has raised an exception.
    bool signal_pending() {
        lock();
        const bool pending = PyErr_CheckSignals() != 0;
        unlock();
        return pending;
    }

    // The lock for a call of Python by the thread that called the core.
    class Locked {
    public:
        Locked() : unlocked_(*innermost()) { unlocked_.lock(); }
        ~Locked() { unlocked_.unlock(); }
        Locked(const Locked&) = delete;
        Locked& operator=(const Locked&) = delete;

    private:
        Unlocked& unlocked_;
    };

private:
    static Unlocked*& innermost() {
        static thread_local Unlocked* unlocked = nullptr;
        return unlocked;
    }
    void unlock() {
        thread_ = PyEval_SaveThread();
        flushed_.emplace();
    }
    void lock() {
        flushed_.reset();
        take_lock(thread_);
    }

    PyThreadState* thread_;
    Unlocked* outer_;
    std::optional<FlushSubnormals> flushed_{std::in_place};
};

}  // namespace clothsim
