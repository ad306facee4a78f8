// The version changes with every commit, so it stands in a file that compiles in no time.
#include "bindings/version.hpp"

namespace clothsim {

const char* const package_version = CLOTHSIM_VERSION;

}  // namespace clothsim
