// A recording replayed through a renderer: asked as it was asked in the session, call by call, it answers the
// same bits, segment by segment between re-arms.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "device/record/recording.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"

namespace palpate::experiments {

/// The ticks from one arming to the next.
struct SegmentReplay {
  std::int64_t start_ns = 0, end_ns = 0;  ///< the servo's clock
  std::uint64_t frames = 0;               ///< ticks in which the renderer was stepped
  std::uint64_t contact_frames = 0;
  bool starts_in_contact = false;            ///< its first frame where the hand is, a bring-up over
  bool brought_up = false;                   ///< the renderer let go or was restarted at its beginning
  bool faulted = false;                      ///< it ends with a fault
  bool whole = true;                         ///< no call of it is missing in the recording
  std::string recorded_hash, replayed_hash;  ///< trace hashes
  std::int64_t differs_ns = -1;              ///< time of the first frame that differs; -1: none

  [[nodiscard]] bool same() const { return recorded_hash == replayed_hash; }
};

/// Index in the table of the renderer with this label, as far as the recording was read; -1: none.
[[nodiscard]] int find_recorded(const device::Recording& recording, const std::string& label);

/// Goes through the whole recording. `label` is the one to compare with; empty: the first of the table.
/// `renderer` is prepared. A recording without this renderer is an Error. Memory does not grow with it.
[[nodiscard]] Result<std::vector<SegmentReplay>> replay_segments(device::Recording& recording,
                                                                 const std::string& label,
                                                                 render::HapticRenderer& renderer,
                                                                 Progress& progress);

/// A table for the terminal, a line a segment.
[[nodiscard]] std::string segments_text(const std::vector<SegmentReplay>& segments);
/// {"schema": "palpate-segments/1", "recording", "renderer", "segments": [..]}.
[[nodiscard]] std::string segments_json(const std::vector<SegmentReplay>& segments,
                                        const std::string& recording, const std::string& renderer);
inline constexpr const char* kSegmentsFile = "segments.json";

}  // namespace palpate::experiments
