#include <algorithm>
#include <array>
#include <vector>

#include "toolkit/core/bytes.h"
#include "toolkit/laz/field_decoders.h"
#include "toolkit/laz/items.h"

namespace palpate::laz {
namespace {

constexpr std::uint32_t kByteSymbols = 256;

// The twenty bytes of every point of formats 0 to 5.
class Point10Item final : public PointwiseItem {
 public:
  void begin(std::span<const std::byte> record) override {
    ByteReader in(record);
    at_.x = in.i32();
    at_.y = in.i32();
    at_.z = in.i32();
    (void)in.u16();  // intensities are predicted from 0
    returns_ = in.u8();
    classification_ = in.u8();
    angle_ = in.u8();
    user_data_ = in.u8();
    source_ = in.u16();
  }

  bool next(ArithmeticDecoder& decoder, std::span<std::byte> record) override {
    enum Changed : std::uint32_t {
      kSource = 1,
      kUserData = 2,
      kAngle = 4,
      kClassification = 8,
      kIntensity = 16,
      kReturns = 32
    };
    const std::uint32_t changed = decoder.symbol(changed_);
    if ((changed & kReturns) != 0) returns_ = byte_symbol(decoder, returns_models_[returns_]);
    const std::uint32_t number = returns_ & kReturnMask, count = returns_ >> kReturnBits & kReturnMask;
    const std::size_t kind = return_kind_of_8(count, number), level = return_level(count, number);
    if ((changed & kIntensity) != 0)
      intensity_of_[kind] = static_cast<std::uint16_t>(
          intensities_.decode(decoder, intensity_of_[kind], std::min(kind, kLastIntensityContext)));
    if (changed != 0) intensity_ = intensity_of_[kind];
    if ((changed & kClassification) != 0)
      classification_ = byte_symbol(decoder, classifications_[classification_]);
    if ((changed & kAngle) != 0)
      angle_ =
          static_cast<std::uint8_t>(angle_ + decoder.symbol(angles_[returns_ >> kScanDirectionBit & 1u]));
    if ((changed & kUserData) != 0) user_data_ = byte_symbol(decoder, user_datas_[user_data_]);
    if ((changed & kSource) != 0) source_ = static_cast<std::uint16_t>(sources_.decode(decoder, source_));

    positions_.next(decoder, &decoder, kind, level, count == 1, at_);

    ByteWriter out(record);
    out.i32(at_.x);
    out.i32(at_.y);
    out.i32(at_.z);
    out.u16(intensity_);
    out.u8(returns_);
    out.u8(classification_);
    out.u8(angle_);
    out.u8(user_data_);
    out.u16(source_);
    return true;
  }

 private:
  static constexpr std::uint32_t kReturnBits = 3, kReturnMask = 7, kScanDirectionBit = 6;
  static constexpr std::uint32_t kChanges = 64;
  static constexpr std::size_t kLastIntensityContext = 3;

  static std::uint8_t byte_symbol(ArithmeticDecoder& decoder, SymbolModel& model) {
    return static_cast<std::uint8_t>(decoder.symbol(model));
  }

  GridPosition at_;
  std::uint16_t intensity_ = 0, source_ = 0;
  std::uint8_t returns_ = 0, classification_ = 0, angle_ = 0, user_data_ = 0;
  SymbolModel changed_{kChanges};
  ModelSet returns_models_{kByteSymbols, kByteSymbols}, classifications_{kByteSymbols, kByteSymbols},
      user_datas_{kByteSymbols, kByteSymbols}, angles_{2, kByteSymbols};
  NumberDecoder intensities_{16, kLastIntensityContext + 1}, sources_{16, 1};
  std::array<std::uint16_t, kReturnKindsOf8> intensity_of_{};
  PositionDecoder positions_{kReturnKindsOf8, 0};
};

class GpsTime11Item final : public PointwiseItem {
 public:
  void begin(std::span<const std::byte> record) override {
    time_ = GpsTimeDecoder(GpsTimeDecoder::Unchanged::kHasSymbol, ByteReader(record).u64());
  }
  bool next(ArithmeticDecoder& decoder, std::span<std::byte> record) override {
    std::uint64_t time = 0;
    const bool possible = time_.next(decoder, time);
    ByteWriter(record).u64(time);
    return possible;
  }

 private:
  GpsTimeDecoder time_{GpsTimeDecoder::Unchanged::kHasSymbol, 0};
};

/// An item whose decoder gives a value from the last one.
template <class Decoder, class Value, Value (*kRead)(ByteReader&) noexcept,
          void (*kWrite)(const Value&, ByteWriter&) noexcept>
class ValueItem final : public PointwiseItem {
 public:
  void begin(std::span<const std::byte> record) override {
    ByteReader in(record);
    last_ = kRead(in);
  }
  bool next(ArithmeticDecoder& decoder, std::span<std::byte> record) override {
    last_ = decoder_.next(decoder, last_);
    ByteWriter out(record);
    kWrite(last_, out);
    return true;
  }

 private:
  Decoder decoder_;
  Value last_;
};
using Colour12Item = ValueItem<ColourDecoder, Colour, read_colour, write_colour>;
using Wavepacket13Item = ValueItem<WavepacketDecoder, Wavepacket, read_wavepacket, write_wavepacket>;

class BytesItem final : public PointwiseItem {
 public:
  explicit BytesItem(std::size_t bytes) : last_(bytes), models_(bytes, kByteSymbols) {}
  void begin(std::span<const std::byte> record) override {
    std::copy(record.begin(), record.end(), last_.begin());
  }
  bool next(ArithmeticDecoder& decoder, std::span<std::byte> record) override {
    for (std::size_t i = 0; i < last_.size(); ++i)
      record[i] = last_[i] =
          static_cast<std::byte>(static_cast<std::uint32_t>(last_[i]) + decoder.symbol(models_[i]));
    return true;
  }

 private:
  std::vector<std::byte> last_;
  ModelSet models_;
};

}  // namespace

std::unique_ptr<PointwiseItem> make_pointwise(const Item& item) {
  switch (item.type) {
    case ItemType::kBytes:
      return std::make_unique<BytesItem>(item.bytes);
    case ItemType::kPoint10:
      return std::make_unique<Point10Item>();
    case ItemType::kGpsTime11:
      return std::make_unique<GpsTime11Item>();
    case ItemType::kColour12:
      return std::make_unique<Colour12Item>();
    case ItemType::kWavepacket13:
      return std::make_unique<Wavepacket13Item>();
    default:
      return nullptr;
  }
}

}  // namespace palpate::laz
