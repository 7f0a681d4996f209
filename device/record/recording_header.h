// Recorded once per file: the session and every renderer that took part.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <palpate/device/device.h>
#include <palpate/device/force_governor.h>
#include <palpate/geometry.h>
#include <palpate/renderer.h>
#include <palpate/vec.h>
#include "toolkit/core/bytes.h"

namespace palpate::device {

/// Increases when the layout changes. Without depth images a file has the first version, which earlier
/// programs read.
inline constexpr std::uint32_t kRecordingVersion = 1;
inline constexpr std::uint32_t kRecordingVersionWithDepth = 2;
inline constexpr const char* kRecordingEnding = "palrec";

struct RecordedRenderer {
  std::string label;                                         ///< unique in the recording
  std::string name;                                          ///< in the registry
  std::vector<std::pair<std::string, std::string>> options;  ///< resolved, complete
};

struct RecordingHeader {
  std::string program;     ///< version and commit of the recording program
  std::string scene;       ///< as written by the user
  std::string scene_text;  ///< content of the scene file; empty for a single model
  std::string scene_hash;  ///< over all that decides what is felt: models, surfaces, control
  std::string device;
  DeviceLimits limits;                         ///< as stated by the open device
  geometry::RigidTransform world_from_device;  ///< p_world = rotation (scale p_device) + translation
  double scale = 1.0;                          ///< of the mapping; 1: one to one
  std::string mapping;                         ///< in words: "one to one", "fitted", "factor 2.5", ..
  double rate_hz = 1000.0;
  std::string scheduling;           ///< obtained by the servo, in words; "virtual clock" if time was not real
  std::string machine;              ///< processor, kernel
  std::string started_utc;          ///< start of the clock, as 2026-01-31T12:00:00Z
  std::int64_t clock_start_ns = 0;  ///< the machine's monotonic clock at the servo clock's 0
  /// Names of RecordedTick::decision; 0 is "none".
  std::vector<std::string> decisions = {"none"};
};

// One recorded servo tick: enough to replay it with any renderer and to show what happened. File layout:
// docs/reference/documents.md.
//
// Renderer calls are recorded one by one, not only the hand's position: a renderer caught up, restarted or
// stepped every other tick takes other steps than the ticks show, and repeats its answers only for the same
// calls.

struct RendererCall {
  enum class Kind : std::uint8_t {
    kStep,            ///< step(hip_mm, t_s)
    kRestart,         ///< restart(hip_mm, t_s)
    kReleaseContact,  ///< release_contact(hip_mm); t_s is 0
  };
  Kind kind = Kind::kStep;
  Vec3 hip_mm = Vec3::Zero();  ///< world frame, bit-exact
  double t_s = 0.0;

  [[nodiscard]] bool operator==(const RendererCall&) const = default;
};

/// Limit of one renderer's calls in one tick. A bring-up makes at most 17, a restart before the first tick
/// one more; the rest allows a second bring-up within one tick.
inline constexpr std::size_t kMaxCalls = 40;

struct RecordedTrack {
  std::uint16_t renderer = 0;  ///< index in the recording's renderer table
  bool stepped = false;
  bool calls_lost = false;                ///< more than kMaxCalls, or not noted: no exact replay from here on
  render::Frame frame;                    ///< of the last step; default if not stepped
  std::int64_t step_ns = 0;               ///< duration of its calls
  std::span<const RendererCall> calls{};  ///< in order; the tick's provider owns the memory
};

struct RecordedTick {
  static constexpr std::size_t kMaxTracks = 8;
  static constexpr std::int8_t kNoTrack = -1;

  std::int64_t t_ns = 0;         ///< servo clock
  double t_s = 0.0;              ///< the same in seconds, bit-exact as passed to the renderers
  std::int64_t dt_ns = 0;        ///< since the previous tick, recorded or not; 0 in the first
  std::int64_t late_ns = 0;      ///< after the due time; 0 if no loop gave one
  std::int64_t exchange_ns = 0;  ///< duration of reading and sending
  bool rearmed = false;          ///< first tick after start or rearm: begins a segment
  DeviceState state;             ///< position in the device frame, buttons, homing, raw packet
  Vec3 hip_mm = Vec3::Zero();    ///< world frame, as passed to the renderers
  Vec3 sent_n = Vec3::Zero();    ///< device frame
  Fault fault = Fault::kNone;    ///< latched

  // State of the mixer; the defaults mean one renderer.
  std::int8_t active = 0;     ///< track that is felt or faded from; kNoTrack: none
  std::int8_t to = kNoTrack;  ///< track that is faded to; kNoTrack: no fade
  double weight = 1.0;        ///< share of `active` in the force, 1 to 0 during a fade
  std::uint8_t request = 0;   ///< 1 + index of the requested track; 0: none
  std::uint8_t decision = 0;  ///< index in RecordingHeader::decisions
  std::uint8_t track_count = 1;
  std::array<RecordedTrack, kMaxTracks> tracks{};

  // Set by the recorder and the reader.
  std::uint64_t lost_before = 0;  ///< ticks lost since the previous one

  [[nodiscard]] std::span<RecordedTrack> tracked() noexcept { return {tracks.data(), track_count}; }
  [[nodiscard]] std::span<const RecordedTrack> tracked() const noexcept {
    return {tracks.data(), track_count};
  }
};

// Internal to recordings: encodes and decodes header, renderers, notes and close.

struct RecordingClose {
  std::uint64_t ticks = 0, written = 0, lost = 0;
  std::string reason;
};

[[nodiscard]] std::vector<std::byte> encode(const RecordingHeader& header);
[[nodiscard]] std::vector<std::byte> encode(std::uint16_t index, const RecordedRenderer& renderer);
[[nodiscard]] std::vector<std::byte> encode_note(const std::string& text);
[[nodiscard]] std::vector<std::byte> encode(const RecordingClose& close);

/// False: malformed.
[[nodiscard]] bool decode(std::span<const std::byte> bytes, RecordingHeader& header);
[[nodiscard]] bool decode(std::span<const std::byte> bytes, std::uint16_t& index, RecordedRenderer& renderer);
[[nodiscard]] bool decode_note(std::span<const std::byte> bytes, std::string& text);
[[nodiscard]] bool decode(std::span<const std::byte> bytes, RecordingClose& close);

// Encodes and decodes a tick as bytes in a recording (docs/reference/documents.md).

// The longest tick: fixed part, raw packet, most tracks with most calls.
inline constexpr std::size_t kVecBytes = 3 * sizeof(double);
inline constexpr std::size_t kMaxCallBytes = 1 + kVecBytes + sizeof(double);
inline constexpr std::size_t kMaxTrackBytes =
    2 + 1 + 8 + 1 + 4 + 2 * kVecBytes + 1 + kMaxCalls * kMaxCallBytes;
inline constexpr std::size_t kMaxBytesATick = 4 + 6 * 8 + 4 + 3 * kVecBytes + RawPacket::kMost + 8 +
                                              (2 + 8 + 2) + 1 + RecordedTick::kMaxTracks * kMaxTrackBytes;

/// Returns the bytes written, at most kMaxBytesATick, for which `into` must have room. Omits default values:
/// 200 bytes for one renderer in contact. No allocation.
[[nodiscard]] std::size_t encode(const RecordedTick& tick, std::span<std::byte> into) noexcept;

using CallStorage = std::array<RendererCall, RecordedTick::kMaxTracks * kMaxCalls>;

/// Bounds on a tick beyond those of every recording.
struct TickBounds {
  std::size_t renderers = 0;
  std::size_t decisions = 1;
};

/// Decodes the next tick; its calls go to `calls`, which must outlive the tick. False: malformed.
[[nodiscard]] bool decode(ByteReader& from, const TickBounds& bounds, CallStorage& calls, RecordedTick& tick);

}  // namespace palpate::device
