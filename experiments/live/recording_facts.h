// What a recording holds, as `palpate info` says it: counted tick by tick, nothing replayed.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "device/record/recording.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

/// A fault that was latched, by name.
struct RecordedFault {
  std::string name;
  std::uint64_t times = 0;  ///< that it began
  double first_s = 0.0;     ///< after the first tick
};

struct RecordedRendererFacts {
  device::RecordedRenderer renderer;
  std::uint64_t ticks = 0;          ///< in which it was stepped
  std::uint64_t contact_ticks = 0;  ///< of these
  std::uint64_t felt_ticks = 0;     ///< in which it was the one that is felt, or that is faded from
  double step_max_us = 0.0;         ///< the longest that its calls took in one tick
};

struct RecordingFacts {
  std::string file;
  std::uint64_t bytes = 0;
  device::RecordingHeader header;
  device::RecordingEnd end;
  double length_s = 0.0;              ///< from the first tick to the last; what was lost between counts
  std::uint64_t segments = 0;         ///< from one arming of the governor to the next
  double late_max_ms = 0.0;           ///< the latest tick, after it was due
  double force_max_n = 0.0;           ///< the largest force sent
  std::vector<RecordedFault> faults;  ///< in the order of their first time
  std::vector<std::pair<std::string, std::uint64_t>> decisions;  ///< of the mixer, and in how many ticks
  std::vector<RecordedRendererFacts> renderers;
  std::vector<std::string> notes;
};

/// Reads all of it: time O(bytes), memory some megabytes. Errors are those of Recording.
[[nodiscard]] Result<RecordingFacts> facts_of_recording(const std::string& file, bool skip_damaged);

/// As docs/info.schema.json says.
[[nodiscard]] std::string facts_json(const RecordingFacts& facts);
/// Lines for a terminal. Control characters of the file's texts are left out.
[[nodiscard]] std::string facts_text(const RecordingFacts& facts);

}  // namespace palpate::experiments
