// Fields that LAZ codes in the same way in its pointwise and in its layered compressor: GPS times, colours
// and what points to a waveform. Each holds its models and, where the coding needs it, what came before.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "toolkit/core/bytes.h"
#include "toolkit/laz/arithmetic_decoder.h"
#include "toolkit/laz/number_decoder.h"

namespace palpate::laz {

/// Times as the bits of a double, predicted from up to four sequences (flight lines that were merged), each
/// with its last time and its usual step.
class GpsTimeDecoder {
 public:
  /// Whether a time equal to the last has a symbol of its own: in the pointwise compressor; the layered one
  /// says elsewhere whether the time changed.
  enum class Unchanged { kHasSymbol, kIsElsewhere };
  GpsTimeDecoder(Unchanged unchanged, std::uint64_t first);

  /// The next time. False where the stream cannot come from an encoder.
  [[nodiscard]] bool next(ArithmeticDecoder& decoder, std::uint64_t& time);

 private:
  struct Sequence {
    std::uint64_t time = 0;
    std::int32_t step = 0;
    std::uint32_t unusual = 0;  ///< steps in a row that were far from `step`
  };
  void begin_sequence(ArithmeticDecoder& decoder);
  void step_by_multiple(ArithmeticDecoder& decoder, std::int32_t multiple);

  std::uint32_t unchanged_symbols_;  ///< 1 or 0
  SymbolModel without_step_, with_step_;
  NumberDecoder steps_;
  std::array<Sequence, 4> sequences_;
  std::size_t last_ = 0, newest_ = 0;
};

struct Colour {
  std::uint16_t red = 0, green = 0, blue = 0;
};

class ColourDecoder {
 public:
  ColourDecoder();
  [[nodiscard]] Colour next(ArithmeticDecoder& decoder, const Colour& last);

 private:
  SymbolModel changed_;
  ModelSet differences_;  ///< by channel and byte
};
inline constexpr std::size_t kColourBytes = 6;
[[nodiscard]] Colour read_colour(ByteReader& in) noexcept;
void write_colour(const Colour& colour, ByteWriter& out) noexcept;

/// Near infrared, by its two bytes.
class InfraredDecoder {
 public:
  InfraredDecoder();
  [[nodiscard]] std::uint16_t next(ArithmeticDecoder& decoder, std::uint16_t last);

 private:
  SymbolModel changed_;
  ModelSet differences_;
};

/// Where a return stands in its waveform; the last four are floats, kept as bits.
struct Wavepacket {
  std::uint8_t descriptor = 0;
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0;
  std::int32_t location = 0, x = 0, y = 0, z = 0;
};

class WavepacketDecoder {
 public:
  WavepacketDecoder();
  [[nodiscard]] Wavepacket next(ArithmeticDecoder& decoder, const Wavepacket& last);

 private:
  SymbolModel descriptors_;
  ModelSet offset_kinds_;  ///< by the last kind
  NumberDecoder offsets_, sizes_, locations_, directions_;
  std::uint32_t last_kind_ = 0;
  std::int32_t last_offset_step_ = 0;
};
inline constexpr std::size_t kWavepacketBytes = 29;
[[nodiscard]] Wavepacket read_wavepacket(ByteReader& in) noexcept;
void write_wavepacket(const Wavepacket& packet, ByteWriter& out) noexcept;

}  // namespace palpate::laz
