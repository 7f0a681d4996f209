// Replays a recording through a renderer, segment by segment between rearms. The same recorded calls must
// give identical bits.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "device/record/recording.h"

namespace palpate::experiments {

/// The ticks between two armings.
struct SegmentReplay {
  std::int64_t start_ns = 0, end_ns = 0;  ///< servo clock
  std::uint64_t frames = 0;               ///< ticks with a step
  std::uint64_t contact_frames = 0;
  bool starts_in_contact = false;            ///< its first frame at the hand, after any bring-up
  bool brought_up = false;                   ///< the renderer released its contact or restarted at the
                                             ///< beginning
  bool faulted = false;                      ///< ends with a fault
  bool whole = true;                         ///< no call is missing in the recording
  std::string recorded_hash, replayed_hash;  ///< trace hashes
  std::int64_t differs_ns = -1;              ///< first differing frame's time; -1: none

  [[nodiscard]] bool same() const { return recorded_hash == replayed_hash; }
};

/// Table index of the renderer with this label in the part read so far; -1: none.
[[nodiscard]] int find_recorded(const device::Recording& recording, const std::string& label);

/// Replays the whole recording. `label` names the renderer compared with; empty: the first. `renderer` must
/// be prepared. Error: the recording lacks it. Memory does not grow with the recording.
[[nodiscard]] Result<std::vector<SegmentReplay>> replay_segments(device::Recording& recording,
                                                                 const std::string& label,
                                                                 render::HapticRenderer& renderer,
                                                                 Progress& progress);

/// A terminal table, one line per segment.
[[nodiscard]] std::string segments_text(const std::vector<SegmentReplay>& segments);
/// {"schema": "palpate-segments/1", "recording", "renderer", "segments": [..]}.
[[nodiscard]] std::string segments_json(const std::vector<SegmentReplay>& segments,
                                        const std::string& recording, const std::string& renderer);
inline constexpr const char* kSegmentsFile = "segments.json";

}  // namespace palpate::experiments
