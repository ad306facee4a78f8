#pragma once

namespace clothsim {

extern const char* const package_version;

}  // namespace clothsim
