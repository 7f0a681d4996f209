// Errors at the edges: reading, configuring, preparing and opening return a Result that says what, where and
// how to mend it. Inside the haptic frame nothing fails this way: a frame reports a status
// (render/renderer.h).
#pragma once

#include <cassert>
#include <cstdint>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

namespace palpate {

/// What went wrong, for a person. `file` and `line` are empty and 0 where they do not apply.
struct Error {
  std::string what;       ///< one plain sentence, no trailing full stop
  std::string remedy;     ///< what the reader can do about it, or empty
  std::string file;       ///< the file that is wrong
  std::int64_t line = 0;  ///< its line, counted from 1; 0 where a line means nothing (binary files)
  bool gave_up = false;   ///< a limit of time or memory was reached: with a higher one it might have worked

  /// "file:line: what; remedy" with the parts that exist.
  [[nodiscard]] std::string message() const;
  /// The same error with the place filled in where it was still empty.
  [[nodiscard]] Error in_file(std::string path, std::int64_t at_line = 0) &&;
};

/// A value or an Error. Not thread-safe, as any value. Reading the wrong side is a programming error
/// (asserted).
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
/// The Result of something that has no value.
using Status = Result<Done>;

}  // namespace palpate
