// What a recording holds of one tick of a servo: enough to go through it again with any renderer, and to show
// what happened. docs/recordings.md has the layout in the file.
//
// What a renderer was asked is kept call by call, not only where the hand was: a renderer that is brought up
// under a hand, restarted or stepped every other tick takes other steps than the ticks show, and answers
// alike only when it is asked alike.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "device/interface/device.h"
#include "device/interface/force_governor.h"
#include "toolkit/core/vec.h"
#include "toolkit/render/renderer.h"

namespace palpate::device {

/// One call of a renderer in a frame.
struct RendererCall {
  enum class Kind : std::uint8_t {
    kStep,     ///< step(hip_mm, t_s)
    kRestart,  ///< restart(hip_mm, t_s)
    kLetGo,    ///< let_go(hip_mm); t_s is 0
  };
  Kind kind = Kind::kStep;
  Vec3 hip_mm = Vec3::Zero();  ///< world frame, to the last bit
  double t_s = 0.0;

  [[nodiscard]] bool operator==(const RendererCall&) const = default;
};

/// Calls of one renderer in one tick. A bring-up makes 17 at most, a restart before the first tick one more;
/// the rest is room for a renderer that is handed over and brought up again within one tick.
inline constexpr std::size_t kMostCalls = 40;

/// One renderer that is kept on the HIP, in one tick.
struct RecordedTrack {
  std::uint16_t renderer = 0;  ///< index in the recording's table of renderers
  bool stepped = false;        ///< at least once
  bool calls_lost = false;     ///< more than kMostCalls, or not noted: it cannot be asked alike any more
  render::Frame frame;         ///< of the last step; default where it was not stepped
  std::int64_t step_ns = 0;    ///< what its calls took
  std::span<const RendererCall> calls{};  ///< all of them in order; whose memory: see who gives the tick
};

struct RecordedTick {
  static constexpr std::size_t kMostTracks = 8;
  static constexpr std::int8_t kNoTrack = -1;

  std::int64_t t_ns = 0;         ///< the servo's clock
  double t_s = 0.0;              ///< the same in seconds, as the renderers got it, to the last bit
  std::int64_t dt_ns = 0;        ///< since the tick before, recorded or not; 0 in the first
  std::int64_t late_ns = 0;      ///< after it was due; 0 where no loop said when
  std::int64_t exchange_ns = 0;  ///< what reading and sending took
  bool rearmed = false;          ///< the first tick after start or rearm: a segment begins
  DeviceState state;             ///< position in the device frame, buttons, homing, raw packet
  Vec3 hip_mm = Vec3::Zero();    ///< world frame, as the renderers got it
  Vec3 sent_n = Vec3::Zero();    ///< device frame
  Fault fault = Fault::kNone;    ///< latched

  // Of the mixer; with one renderer as they stand here.
  std::int8_t active = 0;     ///< index of the track that is felt, or is faded from; kNoTrack: none
  std::int8_t to = kNoTrack;  ///< index of the track that is faded to; kNoTrack: there is no fade
  double weight = 1.0;        ///< share of `active` in the force, 1 to 0 over a fade
  std::uint8_t request = 0;   ///< 1 + index of the track that is asked for; 0: none
  std::uint8_t decision = 0;  ///< what was decided in this tick: index in RecordingHeader::decisions
  std::uint8_t track_count = 1;
  std::array<RecordedTrack, kMostTracks> tracks{};

  // Filled by the recorder and the reader.
  std::uint64_t lost_before = 0;  ///< ticks that were lost between the one before and this one

  [[nodiscard]] std::span<RecordedTrack> tracked() noexcept { return {tracks.data(), track_count}; }
  [[nodiscard]] std::span<const RecordedTrack> tracked() const noexcept {
    return {tracks.data(), track_count};
  }
};

}  // namespace palpate::device
