#include "device/record/recording_header.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/bytes.h"

namespace palpate::device {
namespace {

/// Appends fields to bytes; allocates, so not for frames.
class FieldWriter {
 public:
  template <class... Fields>
  void operator()(const Fields&... fields) {
    (add(fields), ...);
  }
  [[nodiscard]] std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  void add(const std::string& text) { room_for(sizeof(std::uint32_t) + text.size()).text(text); }
  void add(double value) { room_for(sizeof value).real(value); }
  void add(std::uint16_t value) { room_for(sizeof value).u16(value); }
  void add(std::uint64_t value) { room_for(sizeof value).u64(value); }
  void add(std::int64_t value) { room_for(sizeof value).i64(value); }
  void add(const Vec3& value) { room_for(kVecBytes).vec(value); }
  void add(WorkspaceShape shape) { add(static_cast<std::uint16_t>(shape)); }
  template <class A, class B>
  void add(const std::pair<A, B>& both) {
    (*this)(both.first, both.second);
  }
  template <class T>
  void add(const std::vector<T>& list) {
    room_for(sizeof(std::uint32_t)).u32(static_cast<std::uint32_t>(list.size()));
    for (const T& one : list) add(one);
  }
  ByteWriter room_for(std::size_t size) { return append_to(bytes_, size); }
  std::vector<std::byte> bytes_;
};

/// Reads fields in the order in which they were written.
class FieldReader {
 public:
  explicit FieldReader(std::span<const std::byte> bytes) : from_(bytes) {}
  template <class... Fields>
  void operator()(Fields&... fields) {
    (read(fields), ...);
  }
  [[nodiscard]] bool is_whole() const { return from_.good() && from_.left() == 0; }

 private:
  void read(std::string& text) { text = from_.text(); }
  void read(double& value) { value = from_.real(); }
  void read(std::uint16_t& value) { value = from_.u16(); }
  void read(std::uint64_t& value) { value = from_.u64(); }
  void read(std::int64_t& value) { value = from_.i64(); }
  void read(Vec3& value) { value = from_.vec(); }
  void read(WorkspaceShape& shape) {
    const std::uint16_t value = from_.u16();
    if (value > static_cast<std::uint16_t>(WorkspaceShape::kCylinder)) return from_.fail();
    shape = static_cast<WorkspaceShape>(value);
  }
  template <class A, class B>
  void read(std::pair<A, B>& both) {
    (*this)(both.first, both.second);
  }
  template <class T>
  void read(std::vector<T>& list) {
    // Each element holds at least a length, so the rest of the bytes bounds their number.
    const std::size_t count = from_.u32();
    list.clear();
    if (count > from_.left() / sizeof(std::uint32_t)) return from_.fail();
    for (std::size_t i = 0; i < count && from_.good(); ++i) read(list.emplace_back());
  }
  ByteReader from_;
};

template <class... Fields>
std::vector<std::byte> encoded_fields(const Fields&... fields) {
  FieldWriter out;
  out(fields...);
  return out.take();
}

template <class... Fields>
bool decode_fields(std::span<const std::byte> bytes, Fields&... fields) {
  FieldReader from(bytes);
  from(fields...);
  return from.is_whole();
}

/// All fields of a header, which `io` writes or reads.
template <class Io, class Header>
void header_fields(Io& io, Header& header) {
  auto& limits = header.limits;
  auto& rotation = header.world_from_device.rotation;
  io(header.program, header.scene, header.scene_text, header.scene_hash, header.device, header.mapping,
     header.scheduling, header.machine, header.started_utc);
  io(limits.force_max_n, limits.resolution_mm, limits.rate_hz, limits.stiffness_max_n_per_mm,
     limits.damping_max_n_s_per_mm, limits.workspace_mm.low_mm, limits.workspace_mm.high_mm,
     limits.workspace_shape);
  io(rotation.w(), rotation.x(), rotation.y(), rotation.z(), header.world_from_device.translation_mm);
  io(header.scale, header.rate_hz, header.clock_start_ns, header.decisions);
}

// Flags of a tick.
constexpr std::uint8_t kRearmed = 1, kHomed = 2, kLostBefore = 4, kHip = 8, kMixer = 16, kSeconds = 32,
                       kSent = 64;
constexpr std::uint8_t kTickFlags = 127;
// Flags of a track.
constexpr std::uint8_t kStepped = 1, kCallsLost = 2, kContact = 4, kForce = 8, kGodObject = 16, kCalls = 32;
constexpr std::uint8_t kTrackFlags = 63;
constexpr double kSPerNs = 1e-9;

/// Bitwise: -0 differs from 0, and a NaN equals itself.
bool same_bits(double a, double b) noexcept {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}
bool same_bits(const Vec3& a, const Vec3& b) noexcept {
  return same_bits(a.x(), b.x()) && same_bits(a.y(), b.y()) && same_bits(a.z(), b.z());
}
double seconds_of(std::int64_t t_ns) noexcept {
  return static_cast<double>(t_ns) * kSPerNs;
}
Vec3 zero() noexcept {
  return Vec3::Zero();
}

bool is_plain_mix(const RecordedTick& tick) noexcept {
  return tick.active == 0 && tick.to == RecordedTick::kNoTrack && same_bits(tick.weight, 1.0) &&
         tick.request == 0 && tick.decision == 0;
}

/// Exactly one step at the tick's place and time, or no call if not stepped.
bool are_plain_calls(const RecordedTick& tick, const RecordedTrack& track) noexcept {
  if (track.calls.size() != (track.stepped ? 1u : 0u)) return false;
  if (!track.stepped) return true;
  const RendererCall& call = track.calls.front();
  return call.kind == RendererCall::Kind::kStep && same_bits(call.hip_mm, tick.hip_mm) &&
         same_bits(call.t_s, tick.t_s);
}

void encode_track(const RecordedTick& tick, const RecordedTrack& track, ByteWriter& out) noexcept {
  const bool force = track.stepped && !same_bits(track.frame.force_n, zero());
  const bool god_object = track.stepped && !same_bits(track.frame.god_object_mm, tick.hip_mm);
  const bool calls = !are_plain_calls(tick, track);
  // A step without its calls cannot be replayed.
  const bool lost = track.calls_lost || (track.stepped && track.calls.empty());
  out.u16(track.renderer);
  out.u8(static_cast<std::uint8_t>((track.stepped ? kStepped : 0) | (lost ? kCallsLost : 0) |
                                   (track.stepped && track.frame.contact ? kContact : 0) |
                                   (force ? kForce : 0) | (god_object ? kGodObject : 0) |
                                   (calls ? kCalls : 0)));
  out.i64(track.step_ns);
  if (track.stepped) {
    out.u8(static_cast<std::uint8_t>(track.frame.status));
    out.i32(track.frame.model);
  }
  if (force) out.vec(track.frame.force_n);
  if (god_object) out.vec(track.frame.god_object_mm);
  if (!calls) return;
  const std::size_t count = std::min(track.calls.size(), kMaxCalls);
  out.u8(static_cast<std::uint8_t>(count));
  for (const RendererCall& call : track.calls.first(count)) {
    out.u8(static_cast<std::uint8_t>(call.kind));
    out.vec(call.hip_mm);
    if (call.kind != RendererCall::Kind::kReleaseContact) out.real(call.t_s);
  }
}

/// Reads an enumeration whose last value is `last`.
template <class E>
E enumerator(ByteReader& from, E last) noexcept {
  const std::uint8_t value = from.u8();
  if (value > static_cast<std::uint8_t>(last)) from.fail();
  return from.good() ? static_cast<E>(value) : E{};
}

void decode_calls(ByteReader& from, const RecordedTick& tick, bool listed, std::span<RendererCall> room,
                  RecordedTrack& track) noexcept {
  std::size_t count = track.stepped ? 1 : 0;
  if (!listed) {
    if (track.stepped) room[0] = {RendererCall::Kind::kStep, tick.hip_mm, tick.t_s};
  } else {
    count = from.u8();
    if (count > kMaxCalls) {
      from.fail();
      return;
    }
    bool steps = false;
    for (std::size_t i = 0; i < count && from.good(); ++i) {
      RendererCall& call = room[i];
      call.kind = enumerator(from, RendererCall::Kind::kReleaseContact);
      call.hip_mm = from.vec();
      call.t_s = call.kind == RendererCall::Kind::kReleaseContact ? 0.0 : from.real();
      steps = steps || call.kind == RendererCall::Kind::kStep;
    }
    // A stepped track must have a step call.
    if (track.stepped && !steps && !track.calls_lost) from.fail();
  }
  track.calls = room.first(count);
}

void decode_track(ByteReader& from, const TickBounds& bounds, const RecordedTick& tick,
                  std::span<RendererCall> room, RecordedTrack& track) noexcept {
  track = RecordedTrack{};
  track.renderer = from.u16();
  const std::uint8_t flags = from.u8();
  if (track.renderer >= bounds.renderers || (flags & ~kTrackFlags) != 0) from.fail();
  track.stepped = (flags & kStepped) != 0;
  track.calls_lost = (flags & kCallsLost) != 0;
  if (!track.stepped && (flags & (kContact | kForce | kGodObject)) != 0) from.fail();
  track.step_ns = from.i64();
  if (track.stepped) {
    track.frame.contact = (flags & kContact) != 0;
    track.frame.status = enumerator(from, render::FrameStatus::kNonFinite);
    track.frame.model = from.i32();
    track.frame.god_object_mm = tick.hip_mm;
  }
  if ((flags & kForce) != 0) track.frame.force_n = from.vec();
  if ((flags & kGodObject) != 0) track.frame.god_object_mm = from.vec();
  decode_calls(from, tick, (flags & kCalls) != 0, room, track);
}

bool is_sound_mix(const TickBounds& bounds, const RecordedTick& tick) noexcept {
  const auto is_track = [&](std::int8_t index) {
    return index == RecordedTick::kNoTrack || (index >= 0 && index < static_cast<int>(tick.track_count));
  };
  // A session may have no renderer for a while; then `active` is 0, as without a mixer.
  return (is_track(tick.active) || (tick.track_count == 0 && tick.active == 0)) && is_track(tick.to) &&
         tick.weight >= 0.0 && tick.weight <= 1.0 && tick.request <= tick.track_count &&
         tick.decision < bounds.decisions;
}

}  // namespace

std::vector<std::byte> encode(const RecordingHeader& header) {
  FieldWriter out;
  header_fields(out, header);
  return out.take();
}

bool decode(std::span<const std::byte> bytes, RecordingHeader& header) {
  FieldReader from(bytes);
  header_fields(from, header);
  return from.is_whole() && !header.decisions.empty() && std::isfinite(header.rate_hz) &&
         header.rate_hz > 0.0 && std::isfinite(header.scale) && header.scale > 0.0;
}

std::vector<std::byte> encode(std::uint16_t index, const RecordedRenderer& renderer) {
  return encoded_fields(index, renderer.label, renderer.name, renderer.options);
}

bool decode(std::span<const std::byte> bytes, std::uint16_t& index, RecordedRenderer& renderer) {
  return decode_fields(bytes, index, renderer.label, renderer.name, renderer.options);
}

std::vector<std::byte> encode_note(const std::string& text) {
  return encoded_fields(text);
}

bool decode_note(std::span<const std::byte> bytes, std::string& text) {
  return decode_fields(bytes, text);
}

std::vector<std::byte> encode(const RecordingClose& close) {
  return encoded_fields(close.ticks, close.written, close.lost, close.reason);
}

bool decode(std::span<const std::byte> bytes, RecordingClose& close) {
  return decode_fields(bytes, close.ticks, close.written, close.lost, close.reason);
}

std::size_t encode(const RecordedTick& tick, std::span<std::byte> into) noexcept {
  ByteWriter out(into);
  const std::size_t raw_bytes = std::min<std::size_t>(tick.state.raw.size, RawPacket::kMost);
  const bool hip = !same_bits(tick.hip_mm, tick.state.position_mm);
  const bool mixer = !is_plain_mix(tick);
  const bool seconds = !same_bits(tick.t_s, seconds_of(tick.t_ns));
  const bool sent = !same_bits(tick.sent_n, zero());
  out.u8(static_cast<std::uint8_t>((tick.rearmed ? kRearmed : 0) | (tick.state.homed ? kHomed : 0) |
                                   (tick.lost_before > 0 ? kLostBefore : 0) | (hip ? kHip : 0) |
                                   (mixer ? kMixer : 0) | (seconds ? kSeconds : 0) | (sent ? kSent : 0)));
  out.u8(static_cast<std::uint8_t>(tick.state.status));
  out.u8(static_cast<std::uint8_t>(tick.fault));
  out.u8(static_cast<std::uint8_t>(raw_bytes));
  out.i64(tick.t_ns);
  if (seconds) out.real(tick.t_s);
  out.i64(tick.dt_ns);
  out.i64(tick.late_ns);
  out.i64(tick.exchange_ns);
  out.i64(tick.state.packet_ns);
  out.u32(tick.state.buttons);
  out.vec(tick.state.position_mm);
  if (hip) out.vec(tick.hip_mm);
  if (sent) out.vec(tick.sent_n);
  out.raw(std::as_bytes(std::span(tick.state.raw.bytes)).first(raw_bytes));
  if (tick.lost_before > 0) out.u64(tick.lost_before);
  if (mixer) {
    out.i8(tick.active);
    out.i8(tick.to);
    out.real(tick.weight);
    out.u8(tick.request);
    out.u8(tick.decision);
  }
  const std::size_t tracks = std::min<std::size_t>(tick.track_count, RecordedTick::kMaxTracks);
  out.u8(static_cast<std::uint8_t>(tracks));
  for (std::size_t i = 0; i < tracks; ++i) encode_track(tick, tick.tracks[i], out);
  return out.size();
}

bool decode(ByteReader& from, const TickBounds& bounds, CallStorage& calls, RecordedTick& tick) {
  tick = RecordedTick{};
  const std::uint8_t flags = from.u8();
  if ((flags & ~kTickFlags) != 0) from.fail();
  tick.rearmed = (flags & kRearmed) != 0;
  tick.state.homed = (flags & kHomed) != 0;
  tick.state.status = enumerator(from, ReadStatus::kLost);
  tick.fault = static_cast<Fault>(from.u8());  // newer governors have more faults
  tick.state.raw.size = from.u8();
  if (tick.state.raw.size > RawPacket::kMost) from.fail();
  tick.t_ns = from.i64();
  tick.t_s = (flags & kSeconds) != 0 ? from.real() : seconds_of(tick.t_ns);
  tick.dt_ns = from.i64();
  tick.late_ns = from.i64();
  tick.exchange_ns = from.i64();
  tick.state.packet_ns = from.i64();
  tick.state.buttons = from.u32();
  tick.state.position_mm = from.vec();
  tick.hip_mm = (flags & kHip) != 0 ? from.vec() : tick.state.position_mm;
  if ((flags & kSent) != 0) tick.sent_n = from.vec();
  if (!from.good()) return false;
  const std::span<const std::byte> raw = from.raw(tick.state.raw.size);
  if (!raw.empty()) std::memcpy(tick.state.raw.bytes.data(), raw.data(), raw.size());
  if ((flags & kLostBefore) != 0) tick.lost_before = from.u64();
  if ((flags & kMixer) != 0) {
    tick.active = from.i8();
    tick.to = from.i8();
    tick.weight = from.real();
    tick.request = from.u8();
    tick.decision = from.u8();
  }
  tick.track_count = from.u8();
  if (tick.track_count > RecordedTick::kMaxTracks) from.fail();
  if (!from.good() || !std::isfinite(tick.t_s) || !is_sound_mix(bounds, tick)) return false;
  for (std::size_t i = 0; i < tick.track_count; ++i)
    decode_track(from, bounds, tick, std::span(calls).subspan(i * kMaxCalls, kMaxCalls), tick.tracks[i]);
  return from.good();
}

}  // namespace palpate::device
