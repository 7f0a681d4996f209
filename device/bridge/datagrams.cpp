#include "device/bridge/datagrams.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>

#include "toolkit/core/bytes.h"

namespace palpate::device {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic = {'P', 'L', 'P', 'B'};
constexpr std::size_t kHeadBytes = 24, kCrcBytes = 4;
constexpr std::size_t kVectorBytes = 3 * sizeof(double);
constexpr std::size_t kStateBytes = kVectorBytes + 2 * sizeof(std::uint32_t);
constexpr std::size_t kWelcomeNumbers = 13, kShapeBytes = 4;
constexpr std::size_t kWelcomeBytes =
    kWelcomeNumbers * sizeof(double) + kShapeBytes + BridgeWelcome::kNameBytes;
static_assert(kHeadBytes + kWelcomeBytes + kCrcBytes == kMaxDatagramBytes);
static_assert(kHeadBytes + kStateBytes + kCrcBytes <= RawPacket::kMost, "recordings hold a state");

/// Size of what follows the head; nothing for an unknown kind.
std::optional<std::size_t> payload_of(std::uint8_t kind) noexcept {
  switch (static_cast<DatagramKind>(kind)) {
    case DatagramKind::kHello:
    case DatagramKind::kBusy:
    case DatagramKind::kRelease:
    case DatagramKind::kReleased:
      return 0;
    case DatagramKind::kCommand:
      return kVectorBytes;
    case DatagramKind::kState:
      return kStateBytes;
    case DatagramKind::kWelcome:
      return kWelcomeBytes;
  }
  return std::nullopt;
}

void write_welcome(ByteWriter& out, const BridgeWelcome& welcome) noexcept {
  const DeviceLimits& limits = welcome.limits;
  out.real(limits.force_max_n);
  out.vec(limits.workspace_mm.low_mm);
  out.vec(limits.workspace_mm.high_mm);
  for (const double value : {limits.resolution_mm, limits.rate_hz, limits.stiffness_max_n_per_mm,
                             limits.damping_max_n_s_per_mm, welcome.watchdog_s, welcome.max_age_s})
    out.real(value);
  out.u32(static_cast<std::uint32_t>(limits.workspace_shape));
  for (const char c : welcome.name_bytes) out.u8(static_cast<std::uint8_t>(c));
}

BridgeWelcome read_welcome(ByteReader& in, std::uint32_t& shape) noexcept {
  BridgeWelcome welcome;
  DeviceLimits& limits = welcome.limits;
  limits.force_max_n = in.real();
  limits.workspace_mm.low_mm = in.vec();
  limits.workspace_mm.high_mm = in.vec();
  for (double* value : {&limits.resolution_mm, &limits.rate_hz, &limits.stiffness_max_n_per_mm,
                        &limits.damping_max_n_s_per_mm, &welcome.watchdog_s, &welcome.max_age_s})
    *value = in.real();
  shape = in.u32();
  for (char& c : welcome.name_bytes) c = static_cast<char>(in.u8());
  return welcome;
}

bool is_name(const std::array<char, BridgeWelcome::kNameBytes>& name) noexcept {
  constexpr char kFirst = ' ', kLast = '~';
  const auto* const end = std::find(name.begin(), name.end(), '\0');
  return std::all_of(name.begin(), end, [](char c) { return c >= kFirst && c <= kLast; }) &&
         std::all_of(end, name.end(), [](char c) { return c == '\0'; });
}

/// Whether a governor can be made for it.
bool is_welcome(const BridgeWelcome& welcome, std::uint32_t shape) noexcept {
  const DeviceLimits& limits = welcome.limits;
  for (const double value : {limits.force_max_n, limits.rate_hz, welcome.watchdog_s, welcome.max_age_s})
    if (!(std::isfinite(value) && value > 0.0)) return false;
  for (const double value :
       {limits.resolution_mm, limits.stiffness_max_n_per_mm, limits.damping_max_n_s_per_mm})
    if (!(std::isfinite(value) && value >= 0.0)) return false;
  const geometry::Aabb& box = limits.workspace_mm;
  return is_finite(box.low_mm) && is_finite(box.high_mm) &&
         (box.low_mm.array() < box.high_mm.array()).all() &&
         shape <= static_cast<std::uint32_t>(WorkspaceShape::kCylinder) && is_name(welcome.name_bytes);
}

std::uint16_t flags_allowed(DatagramKind kind) noexcept {
  return kind == DatagramKind::kState ? Datagram::kHomed | Datagram::kObeys | Datagram::kStatusMask : 0;
}

}  // namespace

std::string_view BridgeWelcome::name() const noexcept {
  const auto* const end = std::find(name_bytes.begin(), name_bytes.end(), '\0');
  return {name_bytes.data(), static_cast<std::size_t>(end - name_bytes.begin())};
}

std::uint32_t crc32_of(std::span<const std::uint8_t> bytes) noexcept {
  return static_cast<std::uint32_t>(::crc32(0, bytes.data(), static_cast<uInt>(bytes.size())));
}

DatagramBytes::DatagramBytes(const Datagram& datagram) noexcept {
  ByteWriter out{std::span(bytes_)};
  for (const std::uint8_t byte : kMagic) out.u8(byte);
  out.u8(kBridgeVersion);
  out.u8(static_cast<std::uint8_t>(datagram.kind));
  out.u16(datagram.flags);
  out.u64(datagram.session);
  out.u32(datagram.sequence);
  out.u32(datagram.answers);
  if (datagram.kind == DatagramKind::kCommand || datagram.kind == DatagramKind::kState)
    out.vec(datagram.vector);
  if (datagram.kind == DatagramKind::kState) {
    out.u32(datagram.buttons);
    out.u32(datagram.age_us);
  }
  if (datagram.kind == DatagramKind::kWelcome) write_welcome(out, datagram.welcome);
  out.u32(crc32_of(std::span(bytes_).first(out.size())));
  size_ = out.size();
}

std::optional<Datagram> decoded_datagram(std::span<const std::uint8_t> bytes) noexcept {
  constexpr std::size_t kVersionAt = 4, kKindAt = 5, kFlagsAt = 6;
  if (bytes.size() < kHeadBytes + kCrcBytes) return std::nullopt;
  if (!std::equal(kMagic.begin(), kMagic.end(), bytes.begin()) || bytes[kVersionAt] != kBridgeVersion)
    return std::nullopt;
  const std::optional<std::size_t> payload = payload_of(bytes[kKindAt]);
  if (!payload || bytes.size() != kHeadBytes + *payload + kCrcBytes) return std::nullopt;
  const auto body = bytes.first(bytes.size() - kCrcBytes);
  if (ByteReader(bytes.subspan(body.size())).u32() != crc32_of(body)) return std::nullopt;
  ByteReader in(bytes.subspan(kFlagsAt));
  Datagram datagram;
  datagram.kind = static_cast<DatagramKind>(bytes[kKindAt]);
  datagram.flags = in.u16();
  if ((datagram.flags & ~unsigned{flags_allowed(datagram.kind)}) != 0) return std::nullopt;
  datagram.session = in.u64();
  datagram.sequence = in.u32();
  datagram.answers = in.u32();
  if (datagram.kind == DatagramKind::kCommand || datagram.kind == DatagramKind::kState)
    datagram.vector = in.vec();
  if (datagram.kind == DatagramKind::kCommand && !is_finite(datagram.vector)) return std::nullopt;
  if (datagram.kind == DatagramKind::kState) {
    datagram.buttons = in.u32();
    datagram.age_us = in.u32();
  }
  if (datagram.kind == DatagramKind::kWelcome) {
    std::uint32_t shape = 0;
    datagram.welcome = read_welcome(in, shape);
    if (!is_welcome(datagram.welcome, shape)) return std::nullopt;
    datagram.welcome.limits.workspace_shape = static_cast<WorkspaceShape>(shape);
  }
  return datagram;
}

}  // namespace palpate::device
