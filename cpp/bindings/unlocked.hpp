// The lock of the interpreter, released while the core works. Subnormal numbers are zero there, and
// only there.
#pragma once

#include <optional>

#include "bindings/bindings.hpp"
#include "memory/subnormals.hpp"

namespace clothsim {

// A daemon thread may be in the core when the interpreter ends. Where it takes the lock again,
// Python before 3.14 ends the thread, which must not destroy what its frames own: it stays here
// until the process ends.
void take_lock(PyThreadState* thread);

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
    void lock() {
        flushed_.reset();
        take_lock(thread_);
    }

    PyThreadState* thread_;
    std::optional<FlushSubnormals> flushed_{std::in_place};
};

}  // namespace clothsim
