// Counts a part's instructions by single-stepping it from a second process; the rest runs at full speed. For
// parts of some million instructions in programs too slow for an emulator; some 25 microseconds of processor
// time per instruction. Linux only.
#pragma once

#include <array>
#include <functional>
#include <string>

namespace palpate {

/// Shared between the process with the part and the one that steps it.
class SteppedPart {
 public:
  /// Names the next part; no line breaks, truncated if too long.
  void name(const std::string& text) noexcept;
  /// Starts counting; includes some dozen instructions of this call's end.
  void begin() noexcept;
  void end() noexcept { counting_ = 0; }

  [[nodiscard]] bool counting() const noexcept { return counting_ != 0; }
  [[nodiscard]] const char* text() const noexcept { return name_.data(); }

 private:
  static constexpr std::size_t kMostName = 255;
  volatile int counting_ = 0;
  std::array<char, kMostName + 1> name_{};
};

/// Runs `work` in another process. It may mark any number of parts in sequence on its calling thread; a line
/// is printed for each: name, space, instructions. Returns work's result, or 1 if tracing is refused or the
/// process ended by itself.
[[nodiscard]] int run_stepped(const std::function<int(SteppedPart*)>& work);

}  // namespace palpate
