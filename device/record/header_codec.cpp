#include "device/record/header_codec.h"

#include <cmath>

#include "device/record/bytes.h"

namespace palpate::device {
namespace {

/// Grows as needed: not for a frame.
class Bytes {
 public:
  void u16(std::uint16_t value) {
    add(sizeof(value), [&](ByteWriter& out) { out.u16(value); });
  }
  void u32(std::size_t value) {
    add(sizeof(std::uint32_t), [&](ByteWriter& out) { out.u32(static_cast<std::uint32_t>(value)); });
  }
  void u64(std::uint64_t value) {
    add(sizeof(value), [&](ByteWriter& out) { out.u64(value); });
  }
  void real(double value) {
    add(sizeof(value), [&](ByteWriter& out) { out.real(value); });
  }
  void vec(const Vec3& value) {
    add(3 * sizeof(double), [&](ByteWriter& out) { out.vec(value); });
  }
  void text(const std::string& text) {
    add(sizeof(std::uint32_t) + text.size(), [&](ByteWriter& out) { out.text(text); });
  }
  [[nodiscard]] std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  template <class F>
  void add(std::size_t size, const F& write) {
    std::vector<std::byte> more(size);
    ByteWriter out{std::span<std::byte>(more)};
    write(out);
    for (const std::byte byte : more) bytes_.push_back(byte);
  }
  std::vector<std::byte> bytes_;
};

// Every entry takes its length at least: a count that promises more is not believed.
bool can_hold(const ByteReader& from, std::size_t count, std::size_t least_bytes) {
  return count <= from.left() / least_bytes;
}

bool is_whole(const ByteReader& from) {
  return from.good() && from.left() == 0;
}

}  // namespace

std::vector<std::byte> encode(const RecordingHeader& header) {
  Bytes out;
  for (const std::string* text :
       {&header.program, &header.scene, &header.scene_text, &header.scene_hash, &header.device,
        &header.mapping, &header.scheduling, &header.machine, &header.started_utc})
    out.text(*text);
  const DeviceLimits& limits = header.limits;
  for (const double value : {limits.force_max_n, limits.resolution_mm, limits.rate_hz,
                             limits.stiffness_max_n_per_mm, limits.damping_max_n_s_per_mm})
    out.real(value);
  out.vec(limits.workspace_mm.low_mm);
  out.vec(limits.workspace_mm.high_mm);
  out.u16(static_cast<std::uint16_t>(limits.workspace_shape));
  const Eigen::Quaterniond& q = header.world_from_device.rotation;
  for (const double value : {q.w(), q.x(), q.y(), q.z()}) out.real(value);
  out.vec(header.world_from_device.translation_mm);
  out.real(header.scale);
  out.real(header.rate_hz);
  out.u64(static_cast<std::uint64_t>(header.clock_start_ns));
  out.u32(header.decisions.size());
  for (const std::string& decision : header.decisions) out.text(decision);
  return out.take();
}

bool decode(std::span<const std::byte> bytes, RecordingHeader& header) {
  ByteReader from(bytes);
  for (std::string* text :
       {&header.program, &header.scene, &header.scene_text, &header.scene_hash, &header.device,
        &header.mapping, &header.scheduling, &header.machine, &header.started_utc})
    *text = from.text();
  DeviceLimits& limits = header.limits;
  for (double* value : {&limits.force_max_n, &limits.resolution_mm, &limits.rate_hz,
                        &limits.stiffness_max_n_per_mm, &limits.damping_max_n_s_per_mm})
    *value = from.real();
  limits.workspace_mm.low_mm = from.vec();
  limits.workspace_mm.high_mm = from.vec();
  const std::uint16_t shape = from.u16();
  if (shape > static_cast<std::uint16_t>(WorkspaceShape::kCylinder)) return false;
  limits.workspace_shape = static_cast<WorkspaceShape>(shape);
  const double w = from.real(), x = from.real(), y = from.real(), z = from.real();
  header.world_from_device.rotation = Eigen::Quaterniond(w, x, y, z);
  header.world_from_device.translation_mm = from.vec();
  header.scale = from.real();
  header.rate_hz = from.real();
  header.clock_start_ns = from.i64();
  const std::size_t decisions = from.u32();
  if (decisions == 0 || !can_hold(from, decisions, sizeof(std::uint32_t))) return false;
  header.decisions.clear();
  for (std::size_t i = 0; i < decisions && from.good(); ++i) header.decisions.push_back(from.text());
  return is_whole(from) && std::isfinite(header.rate_hz) && header.rate_hz > 0.0 &&
         std::isfinite(header.scale) && header.scale > 0.0;
}

std::vector<std::byte> encode(std::uint16_t index, const RecordedRenderer& renderer) {
  Bytes out;
  out.u16(index);
  out.text(renderer.label);
  out.text(renderer.name);
  out.u32(renderer.options.size());
  for (const auto& [key, value] : renderer.options) {
    out.text(key);
    out.text(value);
  }
  return out.take();
}

bool decode(std::span<const std::byte> bytes, std::uint16_t& index, RecordedRenderer& renderer) {
  ByteReader from(bytes);
  index = from.u16();
  renderer.label = from.text();
  renderer.name = from.text();
  const std::size_t options = from.u32();
  if (!can_hold(from, options, 2 * sizeof(std::uint32_t))) return false;
  renderer.options.clear();
  for (std::size_t i = 0; i < options && from.good(); ++i) {
    std::string key = from.text();
    renderer.options.emplace_back(std::move(key), from.text());
  }
  return is_whole(from);
}

std::vector<std::byte> encode_note(const std::string& text) {
  Bytes out;
  out.text(text);
  return out.take();
}

bool decode_note(std::span<const std::byte> bytes, std::string& text) {
  ByteReader from(bytes);
  text = from.text();
  return is_whole(from);
}

std::vector<std::byte> encode(const RecordingClose& close) {
  Bytes out;
  out.u64(close.ticks);
  out.u64(close.written);
  out.u64(close.lost);
  out.text(close.reason);
  return out.take();
}

bool decode(std::span<const std::byte> bytes, RecordingClose& close) {
  ByteReader from(bytes);
  close.ticks = from.u64();
  close.written = from.u64();
  close.lost = from.u64();
  close.reason = from.text();
  return is_whole(from);
}

}  // namespace palpate::device
