// Version and commit of the build.
#pragma once

#include <string>

namespace palpate::experiments {

/// Twelve digits, "-modified" after them where tracked files differed; "unknown" outside git. Generated at
/// build time.
extern const char* const kCommit;

[[nodiscard]] std::string version_text();  ///< "0.1.0"
[[nodiscard]] std::string build_text();    ///< build type and compiler

[[nodiscard]] std::string flags_text();  ///< of the compiler, warnings left out

}  // namespace palpate::experiments
