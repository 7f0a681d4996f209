// A recording's contents for `palpate info`. They are counted tick by tick without a replay.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "device/record/recording.h"
#include "experiments/streams/open_stream.h"

namespace palpate::experiments {

/// A latched fault, by name.
struct RecordedFault {
  std::string name;
  std::uint64_t times = 0;  ///< occurrences
  double first_s = 0.0;     ///< after the first tick
};

struct RecordedRendererFacts {
  device::RecordedRenderer renderer;
  std::uint64_t ticks = 0;          ///< ticks with a step
  std::uint64_t contact_ticks = 0;  ///< of these
  std::uint64_t felt_ticks = 0;     ///< ticks in which it was felt or being faded out
  double step_max_us = 0.0;         ///< longest time of its calls in one tick
};

struct RecordingFacts {
  std::string file;
  std::uint64_t bytes = 0;
  device::RecordingHeader header;
  device::RecordingEnd end;
  double length_s = 0.0;              ///< first to last tick, lost stretches included
  std::uint64_t segments = 0;         ///< between two armings of the governor
  double late_max_ms = 0.0;           ///< of the latest tick
  double force_max_n = 0.0;           ///< of the forces sent
  std::vector<RecordedFault> faults;  ///< by first occurrence
  std::vector<std::pair<std::string, std::uint64_t>> decisions;  ///< the mixer's, with their numbers of ticks
  std::vector<RecordedRendererFacts> renderers;
  std::vector<std::string> notes;
  std::optional<StreamFacts> stream{};  ///< of its depth images, or none
};

/// Reads the whole recording: O(bytes), some megabytes of memory. Errors: those of Recording.
[[nodiscard]] Result<RecordingFacts> facts_of_recording(const std::string& file, bool skip_damaged);

/// Format: docs/schemas/info.schema.json.
[[nodiscard]] std::string facts_json(const RecordingFacts& facts);
/// Lines for a terminal, without the control characters of the file's texts.
[[nodiscard]] std::string facts_text(const RecordingFacts& facts);

}  // namespace palpate::experiments
