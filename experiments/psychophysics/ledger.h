// The record of a study while it goes on. Rows as they arrive: each is in the file before the next question.
// Sessions at the device, their scheduling and timing: sessions.jsonl has a line per session, for studies of
// several sessions.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include "experiments/psychophysics/trials.h"
#include "experiments/study/output_folder.h"

namespace palpate::experiments::psychophysics {

inline constexpr const char* kSessionsFile = "sessions.jsonl";

/// One session. Lateness runs from a tick's due time to its start.
struct SessionRecord {
  std::string started_utc;
  std::uint64_t first_trial = 0, last_trial = 0;  ///< answered in it; 0: none
  bool real_time = true;                          ///< false: virtual clock
  std::string scheduling;                         ///< granted by the system
  std::vector<std::string> notes;                 ///< what was not granted; the device's facts
  double rate_hz = 0.0;
  std::uint64_t ticks = 0, missed = 0;  ///< missed: whole periods without a tick
  double late_p50_us = 0.0, late_p99_us = 0.0, late_p999_us = 0.0, late_most_us = 0.0;
  /// Frames of answered trials: all, and those that stepped every renderer.
  std::uint64_t trial_frames = 0, whole_frames = 0;
  std::uint64_t watchdog_trips = 0;
  std::uint64_t begun_again = 0;  ///< trials stopped by a fault
};

/// One line without its end.
[[nodiscard]] std::string session_line(const SessionRecord& session);
/// Reads a folder's sessions; empty if there were none.
[[nodiscard]] Result<std::vector<SessionRecord>> read_sessions(const OutputFolder& folder);
/// Writes all sessions; the file is complete or unchanged.
[[nodiscard]] Status write_sessions(const OutputFolder& folder, const std::vector<SessionRecord>& sessions);

/// One thread at a time. Refers to plan, rows and observer.
class Ledger {
 public:
  /// `rows`: earlier sessions' rows; new ones are appended. `stop_after`: trials of this session; 0: all.
  Ledger(const Plan& plan, const std::string& observer, std::vector<Row>& rows, TrialFile file,
         long long stop_after);

  /// True once this session has asked its trials.
  [[nodiscard]] bool session_over() const noexcept { return stop_after_ > 0 && asked_ == stop_after_; }
  /// Empty: the study is complete. Error: excluded answers keep it from ever ending.
  [[nodiscard]] Result<std::optional<Trial>> next() const;
  /// Enters the answer to `trial`, which must be next(). The system has it when this returns.
  [[nodiscard]] Status enter(const Trial& trial, const Answer& answer);

 private:
  const Plan& plan_;
  const std::string& observer_;
  std::vector<Row>& rows_;
  TrialFile file_;
  Course course_;
  long long stop_after_, asked_ = 0;
};

}  // namespace palpate::experiments::psychophysics
