// Copies of rows of large arrays.
#pragma once

#include <cstddef>

namespace clothsim {

// To memory past the caches: nothing there makes room for it, and what it replaces is not fetched first.
void copy_past_caches(const void* from, void* to, std::size_t bytes);

}  // namespace clothsim
