// A progress bar with the time left, on a terminal only.
#pragma once

#include <cstdint>
#include <string>

#include <palpate/progress.h>

namespace palpate::experiments {

/// Draws on standard error from the second second of a phase on; on anything but a terminal a job of
/// several steps (set_prefix) prints a line every few seconds, and any other nothing.
class ProgressBar final : public Progress {
 public:
  ProgressBar();
  ~ProgressBar() override;
  void report(std::string_view what, double fraction) override;

  /// Removes what is drawn, before other text is printed.
  void clear();
  /// Put before every phase, "[2/5] sinusoid: ".
  void set_prefix(std::string prefix) { prefix_ = std::move(prefix); }

 private:
  bool terminal_ = false;
  bool drawn_ = false;
  std::string prefix_;
  std::string phase_;
  std::int64_t phase_start_ns_ = 0;
  std::int64_t last_draw_ns_ = 0;
};

}  // namespace palpate::experiments
