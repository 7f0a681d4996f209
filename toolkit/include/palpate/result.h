// Results and errors of reading, configuring, preparing and opening. An Error says what failed, where, and
// the remedy. Haptic frames report a status instead (renderer.h). Reading is bounded by a limit on memory.
//
// First:
//   if (auto half = half_of(3.0))  // a value, or what was wrong
//     std::printf("%g\n", *half);
//   else
//     std::fprintf(stderr, "%s\n", half.error().message().c_str());
//   PALPATE_TRY(prepare_all());  // or hand the Error on
#pragma once

#include <cassert>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>

namespace palpate {

/// Failure, in words for the user. `file` and `line` are empty and 0 where they do not apply.
struct Error {
  std::string what;       ///< one plain sentence without full stop
  std::string remedy{};   ///< what the user can do, or empty
  std::string file{};     ///< the faulty file
  std::int64_t line = 0;  ///< its line, from 1; 0 for binary files
  bool gave_up = false;   ///< a limit of time or memory was reached; a higher one may help

  /// "file:line: what; remedy" with the parts that exist.
  [[nodiscard]] std::string message() const;
  /// Fills in the place where it is still empty.
  [[nodiscard]] Error in_file(std::string path, std::int64_t at_line = 0) &&;
};

/// A value or an Error. Not thread-safe. Reading the wrong side is a programming error (asserted).
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}      // NOLINT: implicit by design
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}  // NOLINT: implicit by design

  [[nodiscard]] bool ok() const noexcept { return state_.index() == 0; }
  explicit operator bool() const noexcept { return ok(); }

  [[nodiscard]] T& value() & {
    assert(ok());
    return *std::get_if<0>(&state_);
  }
  [[nodiscard]] const T& value() const& {
    assert(ok());
    return *std::get_if<0>(&state_);
  }
  [[nodiscard]] T&& value() && {
    assert(ok());
    return std::move(*std::get_if<0>(&state_));
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  [[nodiscard]] const Error& error() const& {
    assert(!ok());
    return *std::get_if<1>(&state_);
  }
  [[nodiscard]] Error error() && {
    assert(!ok());
    return std::move(*std::get_if<1>(&state_));
  }

 private:
  std::variant<T, Error> state_;
};

struct Done {};
/// The Result of a function without a value.
using Status = Result<Done>;

/// The default limit on memory for reading one file: about 100 million points without faces. A scan of 200
/// million: options.max_bytes = 2 * palpate::kMemoryLimitBytes.
inline constexpr std::uint64_t kMemoryLimitBytes = std::uint64_t{1} << 32;
inline constexpr double kBytesPerGb = 1e9;

/// The Error that `what` needs more than `limit_bytes`; names the option that raises the limit.
[[nodiscard]] Error over_memory_limit(std::string_view what, std::uint64_t limit_bytes);

}  // namespace palpate

// Macros that return the Error of a call early.

/// Calls what gives a Status (or a Result whose value is not wanted) and returns its Error where it failed:
/// PALPATE_TRY(check_size(columns, rows));
#define PALPATE_TRY(...)                                                                                  \
  do {                                                                                                    \
    if (auto palpate_tried = (__VA_ARGS__); !palpate_tried.ok()) return std::move(palpate_tried).error(); \
  } while (false)

/// Declares a variable with the value of a Result, or returns its Error:
/// PALPATE_ASSIGN(const double scale, number(node, "scale"));
/// Two statements: not for the branch of an `if` without braces. A declaration with a comma needs `auto`.
#define PALPATE_ASSIGN(declaration, ...) \
  PALPATE_ASSIGN_AS(PALPATE_CONCAT(palpate_result_, __LINE__), declaration, __VA_ARGS__)
#define PALPATE_ASSIGN_AS(result, declaration, ...)     \
  auto result = (__VA_ARGS__);                          \
  if (!(result).ok()) return std::move(result).error(); \
  declaration = *std::move(result) /* NOLINT(bugprone-macro-parentheses): a declaration */
#define PALPATE_CONCAT(name, line) PALPATE_CONCAT_EXPANDED(name, line)
#define PALPATE_CONCAT_EXPANDED(name, line) name##line
