// Instructions of a part of a program, counted by callgrind: the same on every run, whatever else the machine
// does. The program marks the part and is run a second time under valgrind; nothing but the part is counted.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate {

/// The marks around a part. Outside of valgrind, or where its header was missing at build time, some
/// instructions that do nothing.
void begin_counting() noexcept;
/// `name`: of the part, unique in a run, without line breaks.
void end_counting(const char* name) noexcept;

/// Whether the marks were built in and valgrind is there; otherwise what is missing, with the remedy.
[[nodiscard]] Status can_count();

struct CountOptions {
  double time_limit_s = 0.0;  ///< 0: none
  /// Called several times a second with the number of parts that are counted. False: stop.
  std::function<bool(std::size_t parts)> tick{};
};

/// Runs the program under callgrind to its end: instructions by the names of its parts. An Error where it
/// cannot be run, fails or runs out of time. Everything outside of the marks runs some ten times slower than
/// alone, and on one thread at a time.
[[nodiscard]] Result<std::map<std::string, std::uint64_t>> count_instructions(
    const std::vector<std::string>& command, const CountOptions& options);

}  // namespace palpate
