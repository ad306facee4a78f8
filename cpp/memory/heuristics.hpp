// The tuned numbers of the core, with their units and how they were found. A number that belongs to
// a method, such as the safety factor of the step controller, stands with the method. Python and
// the tests read them from `_core.heuristics`. `make bench` measures what a change costs.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace clothsim::heuristics {

// Threads

// Mass points from which a single cloth is stepped by all threads. Smaller ones gain less than the
// threads would take from others.
inline constexpr std::int64_t points_of_team = 16'384;
// Least mass points per thread of a team that steps a cloth. Such a team is taken to be three
// quarters as many times faster as it has threads. Half and twice were not measured.
inline constexpr std::int64_t points_per_thread_of_step = 1024;
// The same for copies between arrays and the layout. Half and twice were not measured.
inline constexpr std::int64_t points_per_thread_of_copy = 2000;
// The same for the search of points near an obstacle: a thread more costs more than it saves below.
// Half and twice were not measured.
inline constexpr std::int64_t points_per_thread_of_response = 8192;
// Least rows of a thread's band. Half and twice were not measured.
inline constexpr int rows_per_thread = 8;
// A thread that waits looks so many times, 20 to 80 us, as long as a sleep takes. 500 times cost a
// tenth to a half of a step of 128 x 128 points by two threads.
inline constexpr int looks_before_sleep = 2000;
// A yield in place of this sleep would give a busy neighbour its whole time slice, at each halo.
inline constexpr std::chrono::microseconds sleep_of_waiting{20};

// Blocks of steps and Ctrl-C

// Most steps between a copy of the state and its inspection. Half copies and inspects twice as
// often; twice repeats more steps of an unstable run.
inline constexpr std::int64_t steps_of_block = 128;
// The same above the stable time step, where growth is likely, and with error control, whose steps
// cost several of others.
inline constexpr std::int64_t steps_of_short_block = 16;
// Most steps times mass points of a block: Ctrl-C waits while they are repeated, which is 0.1 s of
// RK4 on one slow core.
inline constexpr std::int64_t point_steps_of_block = 1 << 22;
// Steps between two looks at Ctrl-C take half of the 0.1 s within which it ends a call [s].
inline constexpr double seconds_between_polls = 0.05;
// A question takes 0.1 us, or 5 ms where another thread of Python holds the lock. At half, a
// picture would take twice its time there; at twice, Ctrl-C would be late by 10 ms more.
inline constexpr std::chrono::milliseconds time_between_questions{10};

// Caches

inline constexpr std::ptrdiff_t megabyte = 1024 * 1024;  // bytes
// The second-level cache where the system does not report it, and the least and most that are taken
// for it [bytes], since some processors share a larger one.
inline constexpr std::ptrdiff_t default_cache = megabyte;
inline constexpr std::ptrdiff_t least_cache = megabyte / 4;
inline constexpr std::ptrdiff_t most_cache = 2 * megabyte;
// Working set of a strip of a wide cloth, over the second-level cache, in thirds. Where that is
// below 1 MiB, strips are as wide as for 1 MiB: using the third-level cache too costs less than the
// columns that narrow strips compute twice. 4096 columns: 46 -> 22.5 ns a point-step on one thread.
inline constexpr std::ptrdiff_t thirds_of_cache_for_strip = 2;
// Largest working set of a band that is swept stage by stage, over that cache, in quarters. Rows
// need not be fetched ahead then. Other parts were not measured.
inline constexpr std::ptrdiff_t quarters_of_cache_for_sweep = 3;
// A state of more bytes comes from memory each time it is gone over.
inline constexpr std::ptrdiff_t bytes_in_shared_cache = 4 * megabyte;
// Rows of a stage of the edge kernel before the next stage continues. Each stage has code of its
// own, too much to change with every row.
inline constexpr int rows_at_a_time = 4;
// A stage reads a row and the two after it. So a row from memory that is fetched this many rows
// ahead is there one row before its first use.
inline constexpr int rows_before_use = 3;
// Rows of a block of other methods, in bytes, which fit in the first-level cache in some versions,
// and their number. A call for a short row costs as much as its combination. Half makes more calls,
// twice may leave the cache.
inline constexpr std::ptrdiff_t bytes_at_once = 16 * 1024;
inline constexpr std::ptrdiff_t most_rows_at_once = 16;
// Slots for halo rows of a band, one for each stage. Two would be correct too, and were not
// measured.
inline constexpr int halo_slots = 4;

// Accuracy

// A remainder below this part of a step is rounding of the caller's numbers, and no step.
inline constexpr double negligible_step = 1e-9;
// Depth below a true surface up to which nobody is warned [m]: places are rounded by less.
inline constexpr double negligible_depth = 1e-9;
// Extents of a cloth from the origin to its middle, from which on single keeps positions relative
// to there.
inline constexpr double extents_that_are_far = 8;

}  // namespace clothsim::heuristics
