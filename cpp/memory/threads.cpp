#include "memory/threads.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <string_view>
#include <thread>
#include <vector>

namespace clothsim {
namespace {

// Threads that OpenMP keeps for this thread, at least.
thread_local int last_team = 1;

// The runtimes of C, C++ and OpenMP take memory when a thread starts, and end the process where none is left.
// Each of their small requests may take a page; the heap grows by 1 MB at most between the trial and the
// start. Half would do too; twice only refuses threads to more processes that are short of memory.
constexpr std::size_t bytes_of_thread = std::size_t(1) << 21;

// Bytes of stack that OpenMP's runtime takes for a thread, by the form of OMP_STACKSIZE; 0: the system's
// choice.
std::size_t stack_bytes() {
    const char* text = std::getenv("OMP_STACKSIZE");
    if (!text) return 0;
    char* end = nullptr;
    const std::size_t size = std::strtoull(text, &end, 10);
    while (std::isspace(static_cast<unsigned char>(*end))) ++end;
    const std::size_t shift =
        std::string_view("bkmg").find(char(std::tolower(static_cast<unsigned char>(*end))));
    return size << (*end == '\0' || shift == std::string_view::npos ? 10 : 10 * shift);
}

// How many of `count` further threads can live at the same time, each with some memory of its own. The system
// is asked for it: what a heap has left may be another thread's when it is needed.
int startable(int count) {
    static const std::size_t stack = stack_bytes();
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    if (stack > 0)
        pthread_attr_setstacksize(&attributes, stack);  // refused like the runtime's own, if too small
    std::mutex ends;
    std::vector<pthread_t> started;
    std::vector<void*> memory;
    started.reserve(std::size_t(count));
    memory.reserve(std::size_t(count));
    const auto wait = [](void* mutex) -> void* {
        const std::lock_guard<std::mutex> ended(*static_cast<std::mutex*>(mutex));
        return nullptr;
    };
    {
        const std::lock_guard<std::mutex> all_live(ends);
        for (pthread_t thread; int(memory.size()) < count;) {
            if (pthread_create(&thread, &attributes, wait, &ends) != 0) break;
            started.push_back(thread);
            void* const own =
                mmap(nullptr, bytes_of_thread, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
            if (own == MAP_FAILED) break;
            memory.push_back(own);
        }
    }
    for (const pthread_t thread : started) pthread_join(thread, nullptr);
    for (void* const own : memory) munmap(own, bytes_of_thread);
    pthread_attr_destroy(&attributes);
    return int(memory.size());
}

}  // namespace

int available_threads() { return omp_get_num_procs(); }

int granted_threads(int wanted) {
    // libgomp takes 2 kB for a team and 200 bytes for each of its threads, and ends the process where it
    // finds none. Asked for here, it is a std::bad_alloc.
    ::operator delete(::operator new(16384 + 1024 * std::size_t(wanted)));
    return team_for(wanted);
}

int team_for(int wanted) {
    if (wanted > last_team) {
        wanted = std::min(wanted, 1 + startable(wanted - 1));
        // The C++ runtime takes memory when a thread first throws, and ends the process where it finds none.
        std::atomic<int> thrown{0};  // so that no compiler leaves the question out
#pragma omp parallel num_threads(wanted) if (wanted > 1)
        thrown += std::uncaught_exceptions();
    }
    if (wanted > 1) last_team = wanted;  // a region of one thread starts and ends none
    return wanted;
}

void install_fork_handler() {
    // Without this the child inherits a team whose threads do not exist there and waits for them for ever.
    pthread_atfork(
        [] {
            omp_pause_resource_all(omp_pause_soft);
            last_team = 1;
        },
        nullptr, nullptr);
}

void wait_long(const std::atomic<int>& reached, int wanted) {
    using std::chrono::microseconds, std::chrono::steady_clock;
    // Half or twice costs up to a tenth beside two busy processes. On a quiet machine a thread waits as long
    // for a band with more contacts, and would wake too late from a sleep.
    constexpr microseconds spinning{200};
    constexpr microseconds sleep{20};  // Linux adds 50 us, so half or twice changes little
    // `yield` would give up a time slice of milliseconds. To wake a sleeper, `signal` would have to search
    // for it.
    const auto end = steady_clock::now() + spinning;
    while (reached.load(std::memory_order_acquire) < wanted) {
        const auto now = steady_clock::now();
        if (now < end) {
            for (int turn = 0; turn < 20; ++turn) pause_briefly();
        } else {
            std::this_thread::sleep_for(sleep);
            const std::chrono::nanoseconds took = steady_clock::now() - now;
            slept.fetch_add(took.count(), std::memory_order_relaxed);
        }
    }
}

#if defined(__linux__)

bool Processors::take() {
    const int here = sched_getcpu();
    if (here < 0 || here >= most) return true;
    const std::uint64_t bit = std::uint64_t(1) << here % bits;
    return !(taken_[std::size_t(here / bits)].fetch_or(bit, std::memory_order_relaxed) & bit);
}

void Processors::resolve() {
    static_assert(CPU_SETSIZE == most);
    if (take()) return;
    cpu_set_t allowed;
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) return;
    cpu_set_t free = allowed;
    for (int cpu = 0; cpu < most; ++cpu)
        if (CPU_ISSET(cpu, &free) &&
            taken_[std::size_t(cpu / bits)].load(std::memory_order_relaxed) >> cpu % bits & 1)
            CPU_CLR(cpu, &free);
    // It moves at once; where it may be moved later is as before.
    if (CPU_COUNT(&free) == 0 || sched_setaffinity(0, sizeof free, &free) != 0) return;
    sched_setaffinity(0, sizeof allowed, &allowed);
    take();
}

#else

bool Processors::take() { return true; }
void Processors::resolve() {}

#endif

}  // namespace clothsim
