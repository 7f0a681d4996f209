// The items that a LAZ point is made of: 20 or 30 bytes that every point has, GPS time, colours, waveforms,
// and bytes of which nothing is known. Two families: pointwise ones read one stream in turn; layered ones
// have streams of their own, and keep what they learnt apart by the scanner's channel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "toolkit/laz/arithmetic_decoder.h"

namespace palpate::laz {

/// As the file numbers them.
enum class ItemType : std::uint16_t {
  kBytes = 0,
  kPoint10 = 6,
  kGpsTime11 = 7,
  kColour12 = 8,
  kWavepacket13 = 9,
  kPoint14 = 10,
  kColour14 = 11,
  kColourInfrared14 = 12,
  kWavepacket14 = 13,
  kBytes14 = 14,
};

struct Item {
  ItemType type = ItemType::kBytes;
  std::size_t bytes = 0;
  std::uint32_t version = 0;
};

/// An item of the pointwise compressor. `record`: its own bytes of a point.
class PointwiseItem {
 public:
  virtual ~PointwiseItem() = default;
  /// The chunk's first point, which is not coded.
  virtual void begin(std::span<const std::byte> record) = 0;
  /// False where the stream cannot come from an encoder.
  [[nodiscard]] virtual bool next(ArithmeticDecoder& decoder, std::span<std::byte> record) = 0;
};
/// Null for an item of the other family.
[[nodiscard]] std::unique_ptr<PointwiseItem> make_pointwise(const Item& item);

/// An item of the layered compressor. Its streams may be empty: what does not change in a chunk is not there.
class LayeredItem {
 public:
  virtual ~LayeredItem() = default;
  [[nodiscard]] virtual std::size_t layers() const noexcept = 0;
  /// The chunk's first point and layers() streams, which the caller keeps alive. The first item of a point
  /// sets `channel`, the scanner's, which the others follow.
  virtual void begin(std::span<const std::byte> record, std::span<const std::span<const std::byte>> layers,
                     std::uint32_t& channel) = 0;
  /// False where a stream cannot come from an encoder.
  [[nodiscard]] virtual bool next(std::span<std::byte> record, std::uint32_t& channel) = 0;
  /// Whether more was read of a stream than it holds.
  [[nodiscard]] virtual bool damaged() const noexcept = 0;
};
/// Null for an item of the other family.
[[nodiscard]] std::unique_ptr<LayeredItem> make_layered(const Item& item);

}  // namespace palpate::laz
