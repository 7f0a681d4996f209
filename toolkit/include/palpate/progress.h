// Progress reports of long work. The library only reports; the application displays them.
//
// First:
//   struct Dots final : palpate::Progress {
//     void report(std::string_view what, double) override { std::puts(std::string(what).c_str()); }
//   } dots;
//   auto report = renderer->prepare(scene, {.progress = &dots});
#pragma once

#include <string_view>

namespace palpate {

/// A progress sink. Called from one thread at a time, which may be any thread.
class Progress {
 public:
  virtual ~Progress() = default;
  /// `fraction` in [0, 1] of phase `what`; negative if unknown.
  virtual void report(std::string_view what, double fraction) = 0;
  /// True when the user asked to stop; long work then soon returns an Error.
  [[nodiscard]] virtual bool cancelled() const { return false; }
};

/// A sink that ignores reports.
Progress& no_progress() noexcept;

}  // namespace palpate
