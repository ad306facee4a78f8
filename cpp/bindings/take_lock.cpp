// Compiled without exceptions: only then does pthread.h call the handler before the stack is
// unwound. The unwinding of glibc breaks off where code for libc++ stands on the stack.
#include <Python.h>

#if !defined(_WIN32)
#include <pthread.h>
#include <unistd.h>
#endif

namespace clothsim {

void take_lock(PyThreadState* thread) {
#if defined(_WIN32)
    PyEval_RestoreThread(thread);
#else
    const auto stay = [](void*) {
        for (;;) pause();
    };
    pthread_cleanup_push(stay, nullptr);
    PyEval_RestoreThread(thread);
    pthread_cleanup_pop(0);
#endif
}

}  // namespace clothsim
