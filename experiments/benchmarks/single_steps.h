// Instructions of a part of a program, counted one by one: a second process runs the part instruction by
// instruction and everything around it at full speed. For parts of some million instructions in programs that
// would take an hour under an emulator; some 25 microseconds of processor time an instruction. Linux alone.
#pragma once

#include <array>
#include <functional>
#include <string>

namespace palpate {

/// Shared by the process that has the part and the one that steps it.
class SteppedPart {
 public:
  /// What the next part is called, without line breaks; what is too long is cut.
  void name(const std::string& text) noexcept;
  /// From here on instructions count: those of the part, and some dozen of this call's own end.
  void begin() noexcept;
  void end() noexcept { counting_ = 0; }

  [[nodiscard]] bool counting() const noexcept { return counting_ != 0; }
  [[nodiscard]] const char* text() const noexcept { return name_.data(); }

 private:
  static constexpr std::size_t kMostName = 255;
  volatile int counting_ = 0;
  std::array<char, kMostName + 1> name_{};
};

/// Runs `work` in a process of its own, which may mark any number of parts, one after the other, on the
/// thread that it is called on. Prints a line for each: its name, a space, its instructions. What `work`
/// returned, or 1 where the system allows no tracing or the process came to an end by itself.
[[nodiscard]] int run_stepped(const std::function<int(SteppedPart*)>& work);

}  // namespace palpate
