#include "device/bridge/datagrams.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace palpate::device {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic = {'P', 'L', 'P', 'B'};
constexpr std::size_t kHeadBytes = 24, kCrcBytes = 4;
constexpr std::size_t kVectorBytes = 3 * sizeof(double);
constexpr std::size_t kStateBytes = kVectorBytes + 2 * sizeof(std::uint32_t);
constexpr std::size_t kWelcomeNumbers = 13, kShapeBytes = 4;
constexpr std::size_t kWelcomeBytes =
    kWelcomeNumbers * sizeof(double) + kShapeBytes + BridgeWelcome::kNameBytes;
static_assert(kHeadBytes + kWelcomeBytes + kCrcBytes == kMostDatagramBytes);
static_assert(kHeadBytes + kStateBytes + kCrcBytes <= RawPacket::kMost, "recordings hold a state");

/// Of what follows the head; nothing for what is no kind.
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

/// Writes numbers one after the other.
class DatagramWriter {
 public:
  explicit DatagramWriter(std::span<std::uint8_t> into) noexcept : into_(into) {}
  template <class T>
  void number(T value) noexcept {
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      into_[at_++] = static_cast<std::uint8_t>(value & 0xFFU);
      if constexpr (sizeof(T) > 1) value = static_cast<T>(value >> 8U);
    }
  }
  void real(double value) noexcept { number(std::bit_cast<std::uint64_t>(value)); }
  void vector(const Vec3& value) noexcept {
    for (int axis = 0; axis < 3; ++axis) real(value[axis]);
  }
  [[nodiscard]] std::size_t size() const noexcept { return at_; }

 private:
  std::span<std::uint8_t> into_;
  std::size_t at_ = 0;
};

class DatagramParser {
 public:
  explicit DatagramParser(std::span<const std::uint8_t> from) noexcept : from_(from) {}
  template <class T>
  [[nodiscard]] T number() noexcept {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{from_[at_++]} << (8U * i);
    return static_cast<T>(value);
  }
  [[nodiscard]] double real() noexcept { return std::bit_cast<double>(number<std::uint64_t>()); }
  [[nodiscard]] Vec3 vector() noexcept {
    Vec3 value;
    for (int axis = 0; axis < 3; ++axis) value[axis] = real();
    return value;
  }

 private:
  std::span<const std::uint8_t> from_;
  std::size_t at_ = 0;
};

void write_welcome(DatagramWriter& out, const BridgeWelcome& welcome) noexcept {
  const DeviceLimits& limits = welcome.limits;
  out.real(limits.force_max_n);
  out.vector(limits.workspace_mm.low_mm);
  out.vector(limits.workspace_mm.high_mm);
  for (const double value : {limits.resolution_mm, limits.rate_hz, limits.stiffness_max_n_per_mm,
                             limits.damping_max_n_s_per_mm, welcome.watchdog_s, welcome.most_age_s})
    out.real(value);
  out.number(static_cast<std::uint32_t>(limits.workspace_shape));
  for (const char c : welcome.name_bytes) out.number(static_cast<std::uint8_t>(c));
}

BridgeWelcome read_welcome(DatagramParser& in, std::uint32_t& shape) noexcept {
  BridgeWelcome welcome;
  DeviceLimits& limits = welcome.limits;
  limits.force_max_n = in.real();
  limits.workspace_mm.low_mm = in.vector();
  limits.workspace_mm.high_mm = in.vector();
  for (double* value : {&limits.resolution_mm, &limits.rate_hz, &limits.stiffness_max_n_per_mm,
                        &limits.damping_max_n_s_per_mm, &welcome.watchdog_s, &welcome.most_age_s})
    *value = in.real();
  shape = in.number<std::uint32_t>();
  for (char& c : welcome.name_bytes) c = static_cast<char>(in.number<std::uint8_t>());
  return welcome;
}

bool is_name(const std::array<char, BridgeWelcome::kNameBytes>& name) noexcept {
  constexpr char kFirst = ' ', kLast = '~';
  const auto* const end = std::find(name.begin(), name.end(), '\0');
  return std::all_of(name.begin(), end, [](char c) { return c >= kFirst && c <= kLast; }) &&
         std::all_of(end, name.end(), [](char c) { return c == '\0'; });
}

/// What a governor can be made for.
bool is_welcome(const BridgeWelcome& welcome, std::uint32_t shape) noexcept {
  const DeviceLimits& limits = welcome.limits;
  for (const double value : {limits.force_max_n, limits.rate_hz, welcome.watchdog_s, welcome.most_age_s})
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
  constexpr std::uint32_t kReflected = 0xEDB88320U;
  std::uint32_t crc = ~std::uint32_t{0};
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1U) ^ ((crc & 1U) != 0 ? kReflected : 0U);
  }
  return ~crc;
}

DatagramBytes::DatagramBytes(const Datagram& datagram) noexcept {
  DatagramWriter out(bytes_);
  for (const std::uint8_t byte : kMagic) out.number(byte);
  out.number(kBridgeVersion);
  out.number(static_cast<std::uint8_t>(datagram.kind));
  out.number(datagram.flags);
  out.number(datagram.session);
  out.number(datagram.sequence);
  out.number(datagram.answers);
  if (datagram.kind == DatagramKind::kCommand || datagram.kind == DatagramKind::kState)
    out.vector(datagram.vector);
  if (datagram.kind == DatagramKind::kState) {
    out.number(datagram.buttons);
    out.number(datagram.age_us);
  }
  if (datagram.kind == DatagramKind::kWelcome) write_welcome(out, datagram.welcome);
  out.number(crc32_of(std::span(bytes_).first(out.size())));
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
  if (DatagramParser(bytes.subspan(body.size())).number<std::uint32_t>() != crc32_of(body))
    return std::nullopt;
  DatagramParser in(bytes.subspan(kFlagsAt));
  Datagram datagram;
  datagram.kind = static_cast<DatagramKind>(bytes[kKindAt]);
  datagram.flags = in.number<std::uint16_t>();
  if ((datagram.flags & ~unsigned{flags_allowed(datagram.kind)}) != 0) return std::nullopt;
  datagram.session = in.number<std::uint64_t>();
  datagram.sequence = in.number<std::uint32_t>();
  datagram.answers = in.number<std::uint32_t>();
  if (datagram.kind == DatagramKind::kCommand || datagram.kind == DatagramKind::kState)
    datagram.vector = in.vector();
  if (datagram.kind == DatagramKind::kCommand && !is_finite(datagram.vector)) return std::nullopt;
  if (datagram.kind == DatagramKind::kState) {
    datagram.buttons = in.number<std::uint32_t>();
    datagram.age_us = in.number<std::uint32_t>();
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
