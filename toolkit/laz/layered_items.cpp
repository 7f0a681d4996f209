#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "toolkit/core/bytes.h"
#include "toolkit/laz/field_decoders.h"
#include "toolkit/laz/items.h"

namespace palpate::laz {
namespace {

constexpr std::size_t kChannels = 4;  // of the scanner, two bits of a point
constexpr std::uint32_t kAnyByte = 256;
// From this version on, a point takes its values from its own channel at once.
constexpr std::uint32_t kChannelsRepaired = 4;

// A stream that may be empty.
class Layer {
 public:
  void open(std::span<const std::byte> stream) {
    used_ = !stream.empty();
    if (used_) decoder_ = ArithmeticDecoder(stream);
  }
  [[nodiscard]] bool used() const noexcept { return used_; }
  [[nodiscard]] bool damaged() const noexcept { return used_ && decoder_.damaged(); }
  ArithmeticDecoder& operator*() noexcept { return decoder_; }
  ArithmeticDecoder* operator->() noexcept { return &decoder_; }

 private:
  ArithmeticDecoder decoder_;
  bool used_ = false;
};

// Models and last value of an item by channel. A channel that comes for the first time begins with new models
// and the value of the channel before it.
template <class Models, class Value>
class ByChannel {
 public:
  explicit ByChannel(std::uint32_t version) : repaired_(version >= kChannelsRepaired) {}

  void begin(std::uint32_t channel, Value first, Models fresh) {
    models_[channel].emplace(std::move(fresh));
    values_[channel] = std::move(first);
    channel_ = channel;
  }
  template <class MakeModels>
  std::pair<Models&, Value&> at(std::uint32_t channel, MakeModels&& make) {
    // Version 3 goes on with the value of the channel before where a known one comes back, and changes it.
    std::uint32_t value_of = channel_;
    if (channel != channel_) {
      if (!models_[channel]) {
        models_[channel].emplace(make());
        values_[channel] = values_[channel_];
        value_of = channel;
      } else if (repaired_) {
        value_of = channel;
      }
      channel_ = channel;
    }
    return {*models_[channel], values_[value_of]};
  }

 private:
  bool repaired_;
  std::uint32_t channel_ = 0;
  std::array<std::optional<Models>, kChannels> models_;
  std::array<Value, kChannels> values_{};
};

// The thirty bytes of every point of formats 6 to 10.
struct Point14 {
  GridPosition at;
  std::uint16_t intensity = 0;
  std::uint32_t number = 0, count = 0;  // of the return, below 16
  std::uint32_t flags = 0;              // six bits: classification flags, scan direction, edge of flight line
  std::uint8_t classification = 0, user_data = 0;
  std::int16_t angle = 0;
  std::uint16_t source = 0;
  std::uint64_t time = 0;
  bool time_changed = false;
};

constexpr std::uint32_t kNibble = 0xF, kNibbleBits = 4;
// In the file's byte the two bits of the channel stand between the flags.
constexpr std::uint32_t kChannelShift = 4, kChannelMask = 3, kUpperFlagsShift = 2, kUpperFlags = 0x30;

Point14 read_point14(std::span<const std::byte> record, std::uint32_t& channel) noexcept {
  ByteReader in(record);
  Point14 point;
  point.at.x = in.i32();
  point.at.y = in.i32();
  point.at.z = in.i32();
  point.intensity = in.u16();
  const std::uint32_t returns = in.u8();
  point.number = returns & kNibble;
  point.count = returns >> kNibbleBits;
  const std::uint32_t flags = in.u8();
  channel = flags >> kChannelShift & kChannelMask;
  point.flags = (flags & kNibble) | (flags >> kUpperFlagsShift & kUpperFlags);
  point.classification = in.u8();
  point.user_data = in.u8();
  point.angle = static_cast<std::int16_t>(in.u16());
  point.source = in.u16();
  point.time = in.u64();
  return point;
}

void write_point14(const Point14& point, std::uint32_t channel, std::span<std::byte> record) noexcept {
  ByteWriter out(record);
  out.i32(point.at.x);
  out.i32(point.at.y);
  out.i32(point.at.z);
  out.u16(point.intensity);
  out.u8(static_cast<std::uint8_t>(point.number | point.count << kNibbleBits));
  out.u8(static_cast<std::uint8_t>((point.flags & kNibble) | channel << kChannelShift |
                                   (point.flags & kUpperFlags) << kUpperFlagsShift));
  out.u8(point.classification);
  out.u8(point.user_data);
  out.u16(static_cast<std::uint16_t>(point.angle));
  out.u16(point.source);
  out.u64(point.time);
}

// Models of a channel of the scanner.
struct Point14Channel {
  static constexpr std::size_t kReturns = 16, kContextsOfClass = 64, kContextsOfFlags = 64,
                               kContextsOfUserData = 64, kIntensities = 8;
  explicit Point14Channel(const Point14& first)
      : last(first),
        positions(std::size_t{2} * kReturnKindsOf16, first.at.z),
        times(GpsTimeDecoder::Unchanged::kIsElsewhere, first.time) {
    last.time_changed = false;
    intensity_of.fill(first.intensity);
  }

  Point14 last;
  ModelSet changes{8, 128};
  SymbolModel channels{3}, number_steps{13};
  ModelSet counts{kReturns, kReturns}, numbers{kReturns, kReturns};
  PositionDecoder positions;
  ModelSet classifications{kContextsOfClass, kAnyByte};
  ModelSet flags{kContextsOfFlags, 64};
  ModelSet user_datas{kContextsOfUserData, kAnyByte};
  NumberDecoder intensities{16, 4}, angles{16, 2}, sources{16, 1};
  std::array<std::uint16_t, kIntensities> intensity_of{};
  GpsTimeDecoder times;
};

class Point14Item final : public LayeredItem {
 public:
  [[nodiscard]] std::size_t layers() const noexcept override { return kLayers; }

  void begin(std::span<const std::byte> record, std::span<const std::span<const std::byte>> layers,
             std::uint32_t& channel) override {
    for (std::size_t i = 0; i < kLayers; ++i) layers_[i].open(layers[i]);
    const Point14 first = read_point14(record, channel_);
    channels_[channel_].emplace(first);
    channel = channel_;
  }

  [[nodiscard]] bool damaged() const noexcept override {
    return !layers_[kXy].used() ||
           std::any_of(layers_.begin(), layers_.end(), [](const Layer& layer) { return layer.damaged(); });
  }

  bool next(std::span<std::byte> record, std::uint32_t& channel) override {
    ArithmeticDecoder& in = *layers_[kXy];
    const std::uint32_t changed = next_changes(in);
    channel = channel_;
    Point14Channel& learnt = *channels_[channel_];
    Point14& point = learnt.last;
    const bool time_changed = (changed & kTime) != 0;
    next_return(in, changed, learnt);

    const std::size_t kind = 2 * return_kind_of_16(point.count, point.number) + (time_changed ? 1 : 0);
    const std::size_t level = return_level(point.count, point.number);
    learnt.positions.next(in, layers_[kZ].used() ? &*layers_[kZ] : nullptr, kind, level, point.count == 1,
                          point.at);
    next_attributes(changed, learnt);
    bool possible = true;
    if (time_changed && layers_[kTimes].used()) possible = learnt.times.next(*layers_[kTimes], point.time);
    point.time_changed = time_changed;
    write_point14(point, channel_, record);
    return possible;
  }

 private:
  enum Name : std::size_t {
    kXy,
    kZ,
    kClass,
    kFlags,
    kIntensity,
    kAngle,
    kUserData,
    kSource,
    kTimes,
    kLayers
  };
  // Bits of what changed; the two lowest are how the number of the return did.
  enum Change : std::uint32_t {
    kNumber = 3,
    kCount = 4,
    kAngleChange = 8,
    kTime = 16,
    kSourceChange = 32,
    kChannel = 64
  };
  enum NumberChange : std::uint32_t { kSameNumber, kOneMore, kOneLess, kOtherNumber };

  // Bits of what differs from the last point, and of its channel.
  std::uint32_t next_changes(ArithmeticDecoder& in) {
    Point14Channel& learnt = *channels_[channel_];
    const Point14& last = learnt.last;
    const std::size_t context =
        (last.number == 1 ? 1u : 0u) + (last.number >= last.count ? 2u : 0u) + (last.time_changed ? 4u : 0u);
    const std::uint32_t changed = in.symbol(learnt.changes[context]);
    if ((changed & kChannel) != 0) {
      const auto next = static_cast<std::uint32_t>((channel_ + in.symbol(learnt.channels) + 1) % kChannels);
      if (!channels_[next]) channels_[next].emplace(last);
      channel_ = next;
    }
    return changed;
  }

  static void next_return(ArithmeticDecoder& in, std::uint32_t changed, Point14Channel& learnt) {
    constexpr std::uint32_t kReturns = Point14Channel::kReturns;
    Point14& point = learnt.last;
    if ((changed & kCount) != 0) point.count = in.symbol(learnt.counts[point.count]);
    const std::uint32_t how = changed & kNumber;
    if (how == kOneMore) {
      point.number = (point.number + 1) % kReturns;
    } else if (how == kOneLess) {
      point.number = (point.number + kReturns - 1) % kReturns;
    } else if (how == kOtherNumber && (changed & kTime) != 0) {
      point.number = in.symbol(learnt.numbers[point.number]);
    } else if (how == kOtherNumber) {
      constexpr std::uint32_t kLeastOtherStep = 2;
      point.number = (point.number + in.symbol(learnt.number_steps) + kLeastOtherStep) % kReturns;
    }
  }

  void next_attributes(std::uint32_t changed, Point14Channel& learnt) {
    Point14& point = learnt.last;
    const std::size_t time_changed = (changed & kTime) != 0 ? 1 : 0;
    // Whether the return is its pulse's first and its last.
    const std::size_t place = (point.number == 1 ? 2u : 0u) + (point.number >= point.count ? 1u : 0u);
    constexpr std::size_t kSingle = 3;
    if (layers_[kClass].used()) {
      constexpr std::uint32_t kLowClassBits = 0x1F;
      const std::size_t context = (point.classification & kLowClassBits) * 2u + (place == kSingle ? 1u : 0u);
      point.classification =
          static_cast<std::uint8_t>(layers_[kClass]->symbol(learnt.classifications[context]));
    }
    if (layers_[kFlags].used()) point.flags = layers_[kFlags]->symbol(learnt.flags[point.flags]);
    if (layers_[kIntensity].used()) {
      std::uint16_t& expected = learnt.intensity_of[2 * place + time_changed];
      point.intensity = expected =
          static_cast<std::uint16_t>(learnt.intensities.decode(*layers_[kIntensity], expected, place));
    }
    if (layers_[kAngle].used() && (changed & kAngleChange) != 0)
      point.angle =
          static_cast<std::int16_t>(learnt.angles.decode(*layers_[kAngle], point.angle, time_changed));
    if (layers_[kUserData].used()) {
      constexpr std::size_t kUserDataPerContext = kAnyByte / Point14Channel::kContextsOfUserData;
      point.user_data = static_cast<std::uint8_t>(
          layers_[kUserData]->symbol(learnt.user_datas[point.user_data / kUserDataPerContext]));
    }
    if (layers_[kSource].used() && (changed & kSourceChange) != 0)
      point.source = static_cast<std::uint16_t>(learnt.sources.decode(*layers_[kSource], point.source));
  }

  std::array<Layer, kLayers> layers_;
  std::array<std::optional<Point14Channel>, kChannels> channels_;
  std::uint32_t channel_ = 0;
};

// Colour, and near infrared where the item has it.
class Colour14Item final : public LayeredItem {
 public:
  Colour14Item(std::uint32_t version, bool infrared)
      : has_infrared_(infrared), colours_(version), infrareds_(version) {}
  [[nodiscard]] std::size_t layers() const noexcept override { return has_infrared_ ? 2 : 1; }

  void begin(std::span<const std::byte> record, std::span<const std::span<const std::byte>> layers,
             std::uint32_t& channel) override {
    ByteReader in(record);
    colour_layer_.open(layers[0]);
    colours_.begin(channel, read_colour(in), ColourDecoder());
    if (!has_infrared_) return;
    infrared_layer_.open(layers[1]);
    infrareds_.begin(channel, in.u16(), InfraredDecoder());
  }
  bool next(std::span<std::byte> record, std::uint32_t& channel) override {
    ByteWriter out(record);
    auto [colours, last] = colours_.at(channel, [] { return ColourDecoder(); });
    if (colour_layer_.used()) last = colours.next(*colour_layer_, last);
    write_colour(last, out);
    if (!has_infrared_) return true;
    auto [infrareds, before] = infrareds_.at(channel, [] { return InfraredDecoder(); });
    if (infrared_layer_.used()) before = infrareds.next(*infrared_layer_, before);
    out.u16(before);
    return true;
  }
  [[nodiscard]] bool damaged() const noexcept override {
    return colour_layer_.damaged() || infrared_layer_.damaged();
  }

 private:
  bool has_infrared_;
  Layer colour_layer_, infrared_layer_;
  ByChannel<ColourDecoder, Colour> colours_;
  ByChannel<InfraredDecoder, std::uint16_t> infrareds_;
};

class Wavepacket14Item final : public LayeredItem {
 public:
  explicit Wavepacket14Item(std::uint32_t version) : packets_(version) {}
  [[nodiscard]] std::size_t layers() const noexcept override { return 1; }
  void begin(std::span<const std::byte> record, std::span<const std::span<const std::byte>> layers,
             std::uint32_t& channel) override {
    layer_.open(layers[0]);
    ByteReader in(record);
    packets_.begin(channel, read_wavepacket(in), WavepacketDecoder());
  }
  bool next(std::span<std::byte> record, std::uint32_t& channel) override {
    auto [packets, last] = packets_.at(channel, [] { return WavepacketDecoder(); });
    if (layer_.used()) last = packets.next(*layer_, last);
    ByteWriter out(record);
    write_wavepacket(last, out);
    return true;
  }
  [[nodiscard]] bool damaged() const noexcept override { return layer_.damaged(); }

 private:
  Layer layer_;
  ByChannel<WavepacketDecoder, Wavepacket> packets_;
};

class Bytes14Item final : public LayeredItem {
 public:
  explicit Bytes14Item(const Item& item) : layers_(item.bytes), bytes_(item.version) {}
  [[nodiscard]] std::size_t layers() const noexcept override { return layers_.size(); }
  void begin(std::span<const std::byte> record, std::span<const std::span<const std::byte>> layers,
             std::uint32_t& channel) override {
    for (std::size_t i = 0; i < layers_.size(); ++i) layers_[i].open(layers[i]);
    bytes_.begin(channel, {record.begin(), record.end()}, fresh());
  }
  bool next(std::span<std::byte> record, std::uint32_t& channel) override {
    auto [models, last] = bytes_.at(channel, [this] { return fresh(); });
    for (std::size_t i = 0; i < layers_.size(); ++i) {
      if (layers_[i].used())
        last[i] = static_cast<std::byte>(static_cast<std::uint32_t>(last[i]) + layers_[i]->symbol(models[i]));
      record[i] = last[i];
    }
    return true;
  }
  [[nodiscard]] bool damaged() const noexcept override {
    return std::any_of(layers_.begin(), layers_.end(), [](const Layer& layer) { return layer.damaged(); });
  }

 private:
  [[nodiscard]] ModelSet fresh() const { return {layers_.size(), kAnyByte}; }
  std::vector<Layer> layers_;
  ByChannel<ModelSet, std::vector<std::byte>> bytes_;
};

}  // namespace

std::unique_ptr<LayeredItem> make_layered(const Item& item) {
  switch (item.type) {
    case ItemType::kPoint14:
      return std::make_unique<Point14Item>();
    case ItemType::kColour14:
      return std::make_unique<Colour14Item>(item.version, false);
    case ItemType::kColourInfrared14:
      return std::make_unique<Colour14Item>(item.version, true);
    case ItemType::kWavepacket14:
      return std::make_unique<Wavepacket14Item>(item.version);
    case ItemType::kBytes14:
      return std::make_unique<Bytes14Item>(item);
    default:
      return nullptr;
  }
}

}  // namespace palpate::laz
