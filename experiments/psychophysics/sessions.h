// The sessions at the device that a study took, as its sidecar tells them: how the loop was scheduled, and
// how it kept its time. A line of sessions.jsonl each, so that a study of several sessions knows them all.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "experiments/study/output_folder.h"
#include "toolkit/core/result.h"

namespace palpate::experiments::psychophysics {

inline constexpr const char* kSessionsFile = "sessions.jsonl";

/// One session. Times are of the loop's lateness: from when a tick was due to when it began.
struct SessionRecord {
  std::string started_utc;
  std::uint64_t first_trial = 0, last_trial = 0;  ///< that were answered in it; 0: none
  bool real_time = true;                          ///< false: a virtual clock
  std::string scheduling;                         ///< what the machine granted
  std::vector<std::string> notes;                 ///< what it did not grant; facts of the device
  double rate_hz = 0.0;
  std::uint64_t ticks = 0, missed = 0;  ///< missed: whole periods without a tick
  double late_p50_us = 0.0, late_p99_us = 0.0, late_p999_us = 0.0, late_most_us = 0.0;
  /// Of the trials that were answered: all frames, and those in which every renderer was stepped.
  std::uint64_t trial_frames = 0, whole_frames = 0;
  std::uint64_t watchdog_trips = 0;
  std::uint64_t begun_again = 0;  ///< trials that a fault stopped
};

/// A line, without its end.
[[nodiscard]] std::string session_line(const SessionRecord& session);
/// Of the file's text. Errors name the line that is none.
[[nodiscard]] Result<std::vector<SessionRecord>> sessions_of(std::string_view text, const std::string& file);
/// Of a folder; none where nobody sat at a device yet.
[[nodiscard]] Result<std::vector<SessionRecord>> read_sessions(const OutputFolder& folder);
/// All of them; the file is whole or as it was.
[[nodiscard]] Status write_sessions(const OutputFolder& folder, const std::vector<SessionRecord>& sessions);

}  // namespace palpate::experiments::psychophysics
