// Finds packets in a split, joined or damaged stream. They have a fixed length and first byte.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>

namespace palpate::device {

/// `Format` names the type Packet, kStart, kBytes, and decode(bytes), which gives nothing for bytes that are
/// no packet. One thread; no allocation.
template <class Format>
class StreamReader {
 public:
  using Packet = typename Format::Packet;
  using Bytes = std::array<std::uint8_t, Format::kBytes>;

  /// Takes the next byte; returns a packet when it completes one. After damage the search resumes one byte
  /// after the false start, so packets that begin inside a damaged one are found. At worst kBytes^2 steps.
  [[nodiscard]] std::optional<Packet> take(std::uint8_t byte) noexcept {
    if (size_ == 0 && byte != Format::kStart) {
      ++dropped_;
      return std::nullopt;
    }
    held_[size_++] = byte;
    if (size_ < held_.size()) return std::nullopt;
    const std::optional<Packet> packet = Format::decode(held_);
    if (packet) {
      last_ = held_;
      size_ = 0;
      malformed_in_a_row_ = 0;
      return packet;
    }
    count_malformed();
    const auto next = std::find(held_.begin() + 1, held_.end(), Format::kStart);
    dropped_ += static_cast<std::uint64_t>(next - held_.begin());
    size_ = static_cast<std::size_t>(std::copy(next, held_.end(), held_.begin()) - held_.begin());
    return std::nullopt;
  }
  /// A new packet is about to begin: a partial one is discarded and counts as malformed.
  void begin() noexcept {
    if (size_ != 0) count_malformed();
    size_ = 0;
  }
  void clear() noexcept { *this = {}; }

  /// Bytes of the last packet from take().
  [[nodiscard]] const Bytes& bytes() const noexcept { return last_; }
  /// False starts since the last packet, and all of them.
  [[nodiscard]] std::uint32_t malformed_in_a_row() const noexcept { return malformed_in_a_row_; }
  [[nodiscard]] std::uint64_t malformed() const noexcept { return malformed_; }
  /// Total bytes outside packets.
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_; }

 private:
  void count_malformed() noexcept {
    ++malformed_;
    if (malformed_in_a_row_ < std::numeric_limits<std::uint32_t>::max()) ++malformed_in_a_row_;
  }

  Bytes held_{}, last_{};
  std::size_t size_ = 0;
  std::uint32_t malformed_in_a_row_ = 0;
  std::uint64_t malformed_ = 0, dropped_ = 0;
};

}  // namespace palpate::device
