// How long work tells how far it is. The library only reports; who shows it (a bar on a terminal) lives in
// experiments.
#pragma once

#include <string_view>

namespace palpate {

/// A sink for progress. Implementations must be safe to call from any one thread at a time.
class Progress {
 public:
  virtual ~Progress() = default;
  /// `fraction` in [0, 1] of the phase `what`, or negative where the end is not known.
  virtual void report(std::string_view what, double fraction) = 0;
  /// True when the user asked to stop: long work returns an Error soon after.
  [[nodiscard]] virtual bool cancelled() const { return false; }
};

/// The sink that shows nothing.
Progress& no_progress() noexcept;

}  // namespace palpate
