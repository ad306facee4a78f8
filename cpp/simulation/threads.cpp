#include "simulation/threads.hpp"

#include <omp.h>
#include <pthread.h>

namespace clothsim {

int available_threads() { return omp_get_num_procs(); }

void install_fork_handler() {
    // Without this the child inherits a team whose threads do not exist there and waits for them for ever.
    pthread_atfork([] { omp_pause_resource_all(omp_pause_soft); }, nullptr, nullptr);
}

}  // namespace clothsim
