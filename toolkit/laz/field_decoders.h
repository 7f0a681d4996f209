// Decoders of the fields of points in LAZ. Both compressors code whole numbers, positions, GPS times, colours
// and pointers to a waveform. Each decoder holds its models and, where the coding needs it, what came before.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/core/bytes.h"
#include "toolkit/laz/arithmetic_decoder.h"

namespace palpate::laz {

/// Bits of a difference that a model learns; those below them are as good as random.
inline constexpr std::uint32_t kLearntBits = 8;

/// Whole numbers as the difference to a prediction: the count of its bits (by a model per context), its upper
/// eight bits (by a model per count) and the rest as they are.
class NumberDecoder {
 public:
  /// Numbers of `bits`, at most 32, wrapping around; predictions stand in `contexts` classes.
  NumberDecoder(std::uint32_t bits, std::size_t contexts);

  [[nodiscard]] std::int32_t decode(ArithmeticDecoder& decoder, std::int32_t predicted,
                                    std::size_t context = 0);
  /// Bits of the last difference: the next numbers in the file are often as uncertain.
  [[nodiscard]] std::uint32_t last_bits() const noexcept { return last_bits_; }

 private:
  std::uint32_t bits_;
  std::uint32_t last_bits_ = 0;
  ModelSet lengths_;                  ///< by context
  BitModel zero_or_one_;              ///< differences without bits
  std::vector<SymbolModel> leading_;  ///< by count of bits, from 1; made at first use
};

/// The middle of five numbers, of which each new one pushes out an extreme: the largest while numbers come
/// below the middle, then the smallest while they come above. Begins with zeros.
class RunningMedian {
 public:
  [[nodiscard]] std::int32_t get() const noexcept { return sorted_[kMiddle]; }
  void add(std::int32_t number) noexcept;

 private:
  static constexpr std::size_t kNumbers = 5, kMiddle = kNumbers / 2;
  std::array<std::int32_t, kNumbers> sorted_{};
  bool drop_largest_ = true;
};

/// a + b and a * b as the encoder's machine computed them, without the language's overflow.
[[nodiscard]] inline std::int32_t wrapped_sum(std::int32_t a, std::int32_t b) noexcept {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b));
}
[[nodiscard]] inline std::int32_t wrapped_product(std::int32_t a, std::int32_t b) noexcept {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) * static_cast<std::uint32_t>(b));
}

/// Kinds of returns where a pulse has up to 7, and up to 15.
inline constexpr std::size_t kReturnKindsOf8 = 16, kReturnKindsOf16 = 6;
/// The kind of return `number` of a pulse with `count`, each as it stands in the file: below 8, or below 16.
[[nodiscard]] std::size_t return_kind_of_8(std::uint32_t count, std::uint32_t number) noexcept;
[[nodiscard]] std::size_t return_kind_of_16(std::uint32_t count, std::uint32_t number) noexcept;
/// Number of the pulse's returns that follow; numbers that make no sense have a level too.
inline constexpr std::size_t kReturnLevels = 8;
[[nodiscard]] std::size_t return_level(std::uint32_t count, std::uint32_t number) noexcept;

struct GridPosition {
  std::int32_t x = 0, y = 0, z = 0;  ///< in the file's own steps, before scale and offset
};

/// x and y as steps from the last point, predicted by running medians of steps to returns of the same kind; z
/// from the last height at the same level below the pulse's last return.
class PositionDecoder {
 public:
  /// Steps differ by `kinds`; `height` stands for heights that have not come yet.
  PositionDecoder(std::size_t kinds, std::int32_t height);

  /// Moves `position` to the next point. `single`: its pulse has one return. `heights` null: they do not
  /// change.
  void next(ArithmeticDecoder& steps, ArithmeticDecoder* heights, std::size_t kind, std::size_t level,
            bool single, GridPosition& position);

 private:
  std::vector<RunningMedian> x_medians_, y_medians_;
  std::array<std::int32_t, kReturnLevels> height_at_;
  NumberDecoder x_steps_, y_steps_, heights_;
};

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
