// Counts instructions of program parts with callgrind: reproducible under any load. The program marks parts
// and runs a second time under valgrind; only the parts are counted.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <palpate/result.h>

namespace palpate {

/// Marks around a part. A few idle instructions outside valgrind or without its header.
void begin_counting() noexcept;
/// `name`: of the part, unique in a run, without line breaks.
void end_counting(const char* name) noexcept;

/// Checks that marks are built in and valgrind is installed; the Error has the remedy.
[[nodiscard]] Status can_count_instructions();

struct CountOptions {
  double time_limit_s = 0.0;  ///< 0: none
  /// Called several times a second with the number of counted parts; false stops.
  std::function<bool(std::size_t parts)> tick{};
};

/// Runs the program under callgrind and returns instructions by part name. An Error if it cannot run, fails
/// or exceeds the time. Code outside the marks runs some ten times slower, one thread at a time.
[[nodiscard]] Result<std::map<std::string, std::uint64_t>> count_instructions(
    const std::vector<std::string>& command, const CountOptions& options);

}  // namespace palpate
