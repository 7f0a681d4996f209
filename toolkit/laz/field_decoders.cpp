#include "toolkit/laz/field_decoders.h"

#include <algorithm>
#include <limits>

namespace palpate::laz {
namespace {

constexpr std::uint32_t kWordBits = 32;

}  // namespace

NumberDecoder::NumberDecoder(std::uint32_t bits, std::size_t contexts)
    : bits_(bits), lengths_(contexts, bits + 1), leading_(bits) {}

std::int32_t NumberDecoder::decode(ArithmeticDecoder& decoder, std::int32_t predicted, std::size_t context) {
  const std::uint32_t k = last_bits_ = decoder.symbol(lengths_[context]);
  std::int32_t difference = std::numeric_limits<std::int32_t>::min();  // the only one of 32 bits
  if (k == 0) {
    difference = decoder.bit(zero_or_one_) ? 1 : 0;
  } else if (k < kWordBits) {
    SymbolModel& model = leading_[k - 1];
    if (model.empty()) model = SymbolModel(1u << std::min(k, kLearntBits));
    std::uint32_t code = decoder.symbol(model);
    if (k > kLearntBits) code = code << (k - kLearntBits) | decoder.bits(k - kLearntBits);
    // The lower half of the codes are -(2^k - 1) to -2^(k-1), the upper 2^(k-1) + 1 to 2^k.
    code += (code >> (k - 1)) != 0 ? 1u : 1u - (1u << k);
    difference = static_cast<std::int32_t>(code);
  }
  const std::int32_t sum = wrapped_sum(predicted, difference);
  if (bits_ == kWordBits) return sum;
  const std::int32_t range = std::int32_t{1} << bits_;
  return sum < 0 ? sum + range : sum >= range ? sum - range : sum;
}

void RunningMedian::add(std::int32_t number) noexcept {
  if (drop_largest_) {
    drop_largest_ = number < get();
    std::size_t at = kNumbers - 1;
    for (; at > 0 && number < sorted_[at - 1]; --at) sorted_[at] = sorted_[at - 1];
    sorted_[at] = number;
  } else {
    drop_largest_ = !(get() < number);
    std::size_t at = 0;
    for (; at + 1 < kNumbers && sorted_[at + 1] < number; ++at) sorted_[at] = sorted_[at + 1];
    sorted_[at] = number;
  }
}

namespace {

// Contexts of y and z: whether the pulse has one return, and how many bits the step before had, in twos and
// up to a limit.
constexpr std::uint32_t kMostYBits = 20, kMostZBits = 18;
constexpr std::size_t kXContexts = 2, kYContexts = kMostYBits + 2, kZContexts = kMostZBits + 2;

// By count of returns and number of the return. Sound values lie at and below the diagonal; others come from
// files that count from 0, or know only one of the two.
constexpr std::uint8_t kKindsOf8[8][8] = {
    {15, 14, 13, 12, 11, 10, 9, 8},  {14, 0, 1, 3, 6, 10, 10, 9},    {13, 1, 2, 4, 7, 11, 11, 10},
    {12, 3, 4, 5, 8, 12, 12, 11},    {11, 6, 7, 8, 9, 13, 13, 12},   {10, 10, 11, 12, 13, 14, 14, 13},
    {9, 10, 11, 12, 13, 14, 15, 14}, {8, 9, 10, 11, 12, 13, 14, 15},
};
constexpr std::uint8_t kKindsOf16[16][16] = {
    {0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5}, {1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3},
    {2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3}, {3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4}, {5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4},
    {3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4}, {4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4},
    {4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4}, {5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4},
    {5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4}, {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4}, {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4},
    {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5}, {5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5},
};

std::size_t bits_context(std::uint32_t bits, std::uint32_t most, bool single) noexcept {
  return (bits < most ? bits & ~1u : most) + (single ? 1u : 0u);
}

}  // namespace

std::size_t return_kind_of_8(std::uint32_t count, std::uint32_t number) noexcept {
  return kKindsOf8[count][number];
}

std::size_t return_kind_of_16(std::uint32_t count, std::uint32_t number) noexcept {
  return kKindsOf16[count][number];
}

std::size_t return_level(std::uint32_t count, std::uint32_t number) noexcept {
  return std::min<std::size_t>(count > number ? count - number : number - count, kReturnLevels - 1);
}

PositionDecoder::PositionDecoder(std::size_t kinds, std::int32_t height)
    : x_medians_(kinds),
      y_medians_(kinds),
      x_steps_(32, kXContexts),
      y_steps_(32, kYContexts),
      heights_(32, kZContexts) {
  height_at_.fill(height);
}

void PositionDecoder::next(ArithmeticDecoder& steps, ArithmeticDecoder* heights, std::size_t kind,
                           std::size_t level, bool single, GridPosition& position) {
  const std::int32_t x = x_steps_.decode(steps, x_medians_[kind].get(), single ? 1 : 0);
  x_medians_[kind].add(x);
  position.x = wrapped_sum(position.x, x);
  const std::int32_t y =
      y_steps_.decode(steps, y_medians_[kind].get(), bits_context(x_steps_.last_bits(), kMostYBits, single));
  y_medians_[kind].add(y);
  position.y = wrapped_sum(position.y, y);
  if (heights == nullptr) return;
  const std::uint32_t bits = (x_steps_.last_bits() + y_steps_.last_bits()) / 2;
  position.z = heights_.decode(*heights, height_at_[level], bits_context(bits, kMostZBits, single));
  height_at_[level] = position.z;
}

namespace {

// Symbols of a step in multiples of the usual one: 0 to 500; then -1 to -10; then, in the pointwise
// compressor, "unchanged"; then a new sequence and the three others.
constexpr std::uint32_t kLargestMultiple = 500;
constexpr std::uint32_t kNegativeMultiples = 10;
constexpr std::uint32_t kOtherMeanings = 4;
// Symbols where there is no usual step: a step of 32 bits, a new sequence, the three others.
constexpr std::uint32_t kSymbolsWithoutStep = 5;
// Below this many steps, and from it on, multiples are coded apart.
constexpr std::uint32_t kFewSteps = 10;
// After more unusual steps in a row than this, the last of them is the usual one.
constexpr std::uint32_t kMostUnusual = 3;

// Contexts of the steps.
enum StepContext : std::size_t {
  kFirstStep,
  kOneStep,
  kFew,
  kMany,
  kMost,
  kBack,
  kFarBack,
  kNone,
  kUpperHalf
};
constexpr std::size_t kStepContexts = 9;

constexpr std::uint32_t kByteValues = 256;
constexpr std::size_t kColourModels = 6;
// The bit that says that green and blue are not those of a grey.
constexpr std::uint32_t kNotGrey = 1u << 6;
constexpr std::uint32_t kColourChanges = 2 * kNotGrey;
constexpr std::uint32_t kInfraredChanges = 4;
constexpr std::uint32_t kLowByte = 0xFFu;

std::int32_t byte_of(std::uint16_t value, std::uint32_t byte) noexcept {
  return static_cast<std::int32_t>((value >> (8 * byte)) & kLowByte);
}

// `expected`, held within a byte, plus a coded difference that wraps around; at its place in 16 bits.
std::uint32_t byte_from(std::int32_t expected, std::uint32_t difference, std::uint32_t byte) noexcept {
  const auto start = static_cast<std::uint32_t>(std::clamp(expected, 0, static_cast<std::int32_t>(kLowByte)));
  return ((start + difference) & kLowByte) << (8 * byte);
}

}  // namespace

GpsTimeDecoder::GpsTimeDecoder(Unchanged unchanged, std::uint64_t first)
    : unchanged_symbols_(unchanged == Unchanged::kHasSymbol ? 1 : 0),
      without_step_(kSymbolsWithoutStep + unchanged_symbols_),
      with_step_(kLargestMultiple + 1 + kNegativeMultiples + unchanged_symbols_ + kOtherMeanings),
      steps_(32, kStepContexts) {
  sequences_[0].time = first;
}

void GpsTimeDecoder::begin_sequence(ArithmeticDecoder& decoder) {
  const auto upper = static_cast<std::int32_t>(sequences_[last_].time >> 32);
  const auto half = static_cast<std::uint32_t>(steps_.decode(decoder, upper, kUpperHalf));
  newest_ = (newest_ + 1) % sequences_.size();
  last_ = newest_;
  sequences_[last_] = {std::uint64_t{half} << 32 | decoder.bits(32), 0, 0};
}

void GpsTimeDecoder::step_by_multiple(ArithmeticDecoder& decoder, std::int32_t multiple) {
  constexpr auto kMostForward = static_cast<std::int32_t>(kLargestMultiple);
  constexpr auto kMostBack = -static_cast<std::int32_t>(kNegativeMultiples);
  Sequence& sequence = sequences_[last_];
  const std::size_t context = multiple == 0                                     ? kNone
                              : multiple == 1                                   ? kOneStep
                              : multiple == kMostForward                        ? kMost
                              : multiple == kMostBack                           ? kFarBack
                              : multiple < 0                                    ? kBack
                              : multiple < static_cast<std::int32_t>(kFewSteps) ? kFew
                                                                                : kMany;
  const std::int32_t step = steps_.decode(decoder, wrapped_product(multiple, sequence.step), context);
  if (multiple == 1) sequence.unusual = 0;
  if (context == kNone || context == kMost || context == kFarBack) {
    if (++sequence.unusual > kMostUnusual) {
      sequence.step = step;
      sequence.unusual = 0;
    }
  }
  sequence.time += static_cast<std::uint64_t>(std::int64_t{step});
}

bool GpsTimeDecoder::next(ArithmeticDecoder& decoder, std::uint64_t& time) {
  // An encoder changes the sequence only where the time stands within 32 bits of the other, so never twice.
  for (int changes = 0; changes < 2; ++changes) {
    std::uint32_t other = 0;  // 1 to 3: that many sequences on
    Sequence& sequence = sequences_[last_];
    if (sequence.step == 0) {
      const std::uint32_t symbol = decoder.symbol(without_step_);
      if (symbol == unchanged_symbols_) {
        sequence.step = steps_.decode(decoder, 0, kFirstStep);
        sequence.unusual = 0;
        sequence.time += static_cast<std::uint64_t>(std::int64_t{sequence.step});
      } else if (symbol == unchanged_symbols_ + 1) {
        begin_sequence(decoder);
      } else if (symbol > unchanged_symbols_) {
        other = symbol - unchanged_symbols_ - 1;
      }
    } else {
      const std::uint32_t symbol = decoder.symbol(with_step_);
      const std::uint32_t new_sequence = kLargestMultiple + kNegativeMultiples + unchanged_symbols_ + 1;
      if (symbol <= kLargestMultiple) {
        step_by_multiple(decoder, static_cast<std::int32_t>(symbol));
      } else if (symbol <= kLargestMultiple + kNegativeMultiples) {
        step_by_multiple(decoder,
                         static_cast<std::int32_t>(kLargestMultiple) - static_cast<std::int32_t>(symbol));
      } else if (symbol == new_sequence) {
        begin_sequence(decoder);
      } else if (symbol > new_sequence) {
        other = symbol - new_sequence;
      }
    }
    if (other == 0) {
      time = sequences_[last_].time;
      return true;
    }
    last_ = (last_ + other) % sequences_.size();
  }
  return false;
}

ColourDecoder::ColourDecoder() : changed_(kColourChanges), differences_(kColourModels, kByteValues) {}

Colour ColourDecoder::next(ArithmeticDecoder& decoder, const Colour& last) {
  const std::uint32_t changed = decoder.symbol(changed_);
  std::uint32_t red = 0, green = 0, blue = 0;
  const auto decode = [&](std::uint32_t channel, std::uint32_t byte, std::int32_t expected,
                          std::uint16_t before) {
    const std::uint32_t model = 2 * channel + byte;
    if ((changed >> model & 1u) == 0) return before & kLowByte << (8 * byte);
    return byte_from(expected, decoder.symbol(differences_[model]), byte);
  };
  for (std::uint32_t byte = 0; byte < 2; ++byte) red |= decode(0, byte, byte_of(last.red, byte), last.red);
  if ((changed & kNotGrey) == 0) {
    const auto grey = static_cast<std::uint16_t>(red);
    return {grey, grey, grey};
  }
  for (std::uint32_t byte = 0; byte < 2; ++byte) {
    std::int32_t moved = byte_of(static_cast<std::uint16_t>(red), byte) - byte_of(last.red, byte);
    green |= decode(1, byte, moved + byte_of(last.green, byte), last.green);
    moved = (moved + byte_of(static_cast<std::uint16_t>(green), byte) - byte_of(last.green, byte)) / 2;
    blue |= decode(2, byte, moved + byte_of(last.blue, byte), last.blue);
  }
  return {static_cast<std::uint16_t>(red), static_cast<std::uint16_t>(green),
          static_cast<std::uint16_t>(blue)};
}

Colour read_colour(ByteReader& in) noexcept {
  Colour colour;
  colour.red = in.u16();
  colour.green = in.u16();
  colour.blue = in.u16();
  return colour;
}

void write_colour(const Colour& colour, ByteWriter& out) noexcept {
  out.u16(colour.red);
  out.u16(colour.green);
  out.u16(colour.blue);
}

InfraredDecoder::InfraredDecoder() : changed_(kInfraredChanges), differences_(2, kByteValues) {}

std::uint16_t InfraredDecoder::next(ArithmeticDecoder& decoder, std::uint16_t last) {
  const std::uint32_t changed = decoder.symbol(changed_);
  std::uint32_t infrared = 0;
  for (std::uint32_t byte = 0; byte < 2; ++byte)
    infrared |= (changed >> byte & 1u) == 0
                    ? last & kLowByte << (8 * byte)
                    : byte_from(byte_of(last, byte), decoder.symbol(differences_[byte]), byte);
  return static_cast<std::uint16_t>(infrared);
}

WavepacketDecoder::WavepacketDecoder()
    : descriptors_(kByteValues),
      offset_kinds_(4, 4),
      offsets_(32, 1),
      sizes_(32, 1),
      locations_(32, 1),
      directions_(32, 3) {}

Wavepacket WavepacketDecoder::next(ArithmeticDecoder& decoder, const Wavepacket& last) {
  enum Offset : std::uint32_t { kSame, kBehindLast, kStep, kAnew };
  Wavepacket packet;
  packet.descriptor = static_cast<std::uint8_t>(decoder.symbol(descriptors_));
  last_kind_ = decoder.symbol(offset_kinds_[last_kind_]);
  packet.offset = last.offset;
  if (last_kind_ == kBehindLast) {
    packet.offset += last.bytes;
  } else if (last_kind_ == kStep) {
    last_offset_step_ = offsets_.decode(decoder, last_offset_step_);
    packet.offset += static_cast<std::uint64_t>(std::int64_t{last_offset_step_});
  } else if (last_kind_ == kAnew) {
    const std::uint64_t low = decoder.bits(32);
    packet.offset = std::uint64_t{decoder.bits(32)} << 32 | low;
  }
  packet.bytes = static_cast<std::uint32_t>(sizes_.decode(decoder, static_cast<std::int32_t>(last.bytes)));
  packet.location = locations_.decode(decoder, last.location);
  packet.x = directions_.decode(decoder, last.x, 0);
  packet.y = directions_.decode(decoder, last.y, 1);
  packet.z = directions_.decode(decoder, last.z, 2);
  return packet;
}

Wavepacket read_wavepacket(ByteReader& in) noexcept {
  Wavepacket packet;
  packet.descriptor = in.u8();
  packet.offset = in.u64();
  packet.bytes = in.u32();
  packet.location = in.i32();
  packet.x = in.i32();
  packet.y = in.i32();
  packet.z = in.i32();
  return packet;
}

void write_wavepacket(const Wavepacket& packet, ByteWriter& out) noexcept {
  out.u8(packet.descriptor);
  out.u64(packet.offset);
  out.u32(packet.bytes);
  out.i32(packet.location);
  out.i32(packet.x);
  out.i32(packet.y);
  out.i32(packet.z);
}

}  // namespace palpate::laz
