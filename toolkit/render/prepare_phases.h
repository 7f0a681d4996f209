// Records the phases of a preparation in its report.
#pragma once

#include <string>
#include <utility>

#include <palpate/clock.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>

namespace palpate::render {

/// begin(name), the work, end() make one phase; a failing phase omits end(). Belongs to one thread; the
/// report and context must outlive it.
class PreparePhases {
 public:
  PreparePhases(PrepareReport& report, const PrepareContext& context) noexcept
      : report_(report), progress_(context.progress != nullptr ? *context.progress : no_progress()) {}
  void begin(std::string name) {
    name_ = std::move(name);
    progress_.report(name_, -1.0);
    watch_.restart();
  }
  void end() { add({name_, watch_.ms()}); }
  /// Adds a phase timed elsewhere.
  void add(PreparePhase phase) {
    report_.total_ms += phase.ms;
    report_.phases.push_back(std::move(phase));
  }
  void note(std::string text) { report_.notes.push_back(std::move(text)); }
  void warn(std::string text) { report_.warnings.push_back(std::move(text)); }
  [[nodiscard]] Progress& progress() noexcept { return progress_; }

 private:
  PrepareReport& report_;
  Progress& progress_;
  std::string name_;
  Stopwatch watch_;
};

}  // namespace palpate::render
