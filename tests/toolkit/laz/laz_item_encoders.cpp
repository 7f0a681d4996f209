// The items of the test encoder, pointwise and layered.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>

#include "tests/toolkit/laz/laz_encoder.h"
#include "toolkit/core/bytes.h"
#include "toolkit/laz/field_decoders.h"

namespace palpate::laz::test {
namespace {

using Bytes = std::span<const std::byte>;

std::uint32_t u8_at(Bytes bytes, std::size_t at) {
  return static_cast<std::uint32_t>(bytes[at]);
}
std::uint32_t u16_at(Bytes bytes, std::size_t at) {
  return ByteReader(bytes.subspan(at)).u16();
}

struct GpsTimes {
  explicit GpsTimes(bool unchanged_symbol, std::uint64_t first)
      : unchanged(unchanged_symbol ? 1 : 0), without_step(5 + unchanged), with_step(515 + unchanged) {
    time[0] = first;
  }
  void encode(ArithmeticEncoder& to, std::uint64_t next) {
    if (unchanged == 1 && next == time[last]) {
      to.symbol(step[last] == 0 ? without_step : with_step, step[last] == 0 ? 0 : 511);
      return;
    }
    const auto small = [&](std::size_t s) {
      const auto d = static_cast<std::int64_t>(next - time[s]);
      return d == static_cast<std::int32_t>(d);
    };
    if (small(last)) {
      const auto d = static_cast<std::int32_t>(static_cast<std::int64_t>(next - time[last]));
      if (step[last] == 0) {
        to.symbol(without_step, unchanged);
        steps.encode(to, 0, d, 0);
        step[last] = d;
        unusual[last] = 0;
      } else {
        multiple(to, d);
      }
      time[last] = next;
      return;
    }
    for (std::uint32_t i = 1; i < 4; ++i) {
      if (!small((last + i) & 3)) continue;
      to.symbol(step[last] == 0 ? without_step : with_step, (step[last] == 0 ? 1 : 511) + unchanged + i);
      last = (last + i) & 3;
      return encode(to, next);
    }
    to.symbol(step[last] == 0 ? without_step : with_step, (step[last] == 0 ? 1 : 511) + unchanged);
    steps.encode(to, static_cast<std::int32_t>(time[last] >> 32), static_cast<std::int32_t>(next >> 32), 8);
    to.bits(static_cast<std::uint32_t>(next), 32);
    newest = last = (newest + 1) & 3;
    time[last] = next;
    step[last] = 0;
    unusual[last] = 0;
  }

  void multiple(ArithmeticEncoder& to, std::int32_t d) {
    const double ratio = std::round(static_cast<double>(d) / step[last]);
    const auto m = static_cast<std::int32_t>(std::clamp(ratio, -10.0, 500.0));
    to.symbol(with_step, static_cast<std::uint32_t>(m >= 0 ? m : 500 - m));
    const std::size_t context = m == 0     ? 7
                                : m == 1   ? 1
                                : m == 500 ? 4
                                : m == -10 ? 6
                                : m < 0    ? 5
                                : m < 10   ? 2
                                           : 3;
    steps.encode(to, wrapped_product(m, step[last]), d, context);
    if (m == 1) unusual[last] = 0;
    if ((m == 0 || m == 500 || m == -10) && ++unusual[last] > 3) {
      step[last] = d;
      unusual[last] = 0;
    }
  }

  std::uint32_t unchanged;
  SymbolModel without_step, with_step;
  NumberEncoder steps{32, 9};
  std::array<std::uint64_t, 4> time{};
  std::array<std::int32_t, 4> step{};
  std::array<int, 4> unusual{};
  std::size_t last = 0, newest = 0;
};

struct Colours {
  SymbolModel changed{128};
  ModelSet differences{6, 256};
  void encode(ArithmeticEncoder& to, const Colour& last, const Colour& next) {
    const std::uint16_t before[] = {last.red, last.green, last.blue},
                        after[] = {next.red, next.green, next.blue};
    const auto byte = [](std::uint16_t value, std::uint32_t b) { return value >> (8 * b) & 0xFF; };
    std::uint32_t bits = next.red == next.green && next.red == next.blue ? 0u : 64u;
    for (std::uint32_t i = 0; i < 6; ++i)
      if (byte(before[i / 2], i % 2) != byte(after[i / 2], i % 2)) bits |= 1u << i;
    if ((bits & 64u) == 0) bits |= (bits & 3u) << 2 | (bits & 3u) << 4;
    to.symbol(changed, bits);
    const auto put = [&](std::uint32_t channel, std::uint32_t b, int moved) {
      const std::uint32_t i = 2 * channel + b;
      if ((bits >> i & 1u) == 0) return;
      const int expected = std::clamp(moved + byte(before[channel], b), 0, 255);
      to.symbol(differences[i], static_cast<std::uint32_t>(byte(after[channel], b) - expected) & 255u);
    };
    put(0, 0, 0);
    put(0, 1, 0);
    if ((bits & 64u) == 0) return;
    for (std::uint32_t b = 0; b < 2; ++b) {
      int moved = byte(after[0], b) - byte(before[0], b);
      put(1, b, moved);
      moved = (moved + byte(after[1], b) - byte(before[1], b)) / 2;
      put(2, b, moved);
    }
  }
};

struct Infrareds {
  SymbolModel changed{4};
  ModelSet differences{2, 256};
  void encode(ArithmeticEncoder& to, std::uint32_t last, std::uint32_t next) {
    const std::uint32_t bits = ((last ^ next) & 0xFFu ? 1u : 0u) | ((last ^ next) & 0xFF00u ? 2u : 0u);
    to.symbol(changed, bits);
    for (std::uint32_t b = 0; b < 2; ++b)
      if ((bits >> b & 1u) != 0) to.symbol(differences[b], ((next >> (8 * b)) - (last >> (8 * b))) & 255u);
  }
};

struct Wavepackets {
  SymbolModel descriptors{256};
  ModelSet kinds{4, 4};
  NumberEncoder offsets{32, 1}, sizes{32, 1}, locations{32, 1}, directions{32, 3};
  std::uint32_t kind = 0;
  std::int32_t step = 0;
  void encode(ArithmeticEncoder& to, const Wavepacket& last, const Wavepacket& next) {
    to.symbol(descriptors, next.descriptor);
    const auto difference = static_cast<std::int64_t>(next.offset - last.offset);
    const std::uint32_t how = difference == 0                                       ? 0
                              : difference == std::int64_t{last.bytes}              ? 1
                              : difference == static_cast<std::int32_t>(difference) ? 2
                                                                                    : 3;
    to.symbol(kinds[kind], how);
    kind = how;
    if (how == 2) {
      offsets.encode(to, step, static_cast<std::int32_t>(difference));
      step = static_cast<std::int32_t>(difference);
    } else if (how == 3) {
      to.bits(static_cast<std::uint32_t>(next.offset), 32);
      to.bits(static_cast<std::uint32_t>(next.offset >> 32), 32);
    }
    sizes.encode(to, static_cast<std::int32_t>(last.bytes), static_cast<std::int32_t>(next.bytes));
    locations.encode(to, last.location, next.location);
    directions.encode(to, last.x, next.x, 0);
    directions.encode(to, last.y, next.y, 1);
    directions.encode(to, last.z, next.z, 2);
  }
};

struct Positions {
  Positions(std::size_t kinds, std::int32_t height) : x_medians(kinds), y_medians(kinds) {
    heights.fill(height);
  }
  std::vector<RunningMedian> x_medians, y_medians;
  std::array<std::int32_t, kReturnLevels> heights{};
  NumberEncoder xs{32, 2}, ys{32, 22}, zs{32, 20};
  void encode(ArithmeticEncoder& to, ArithmeticEncoder& z_to, std::size_t kind, std::size_t level,
              bool single, const GridPosition& last, const GridPosition& next) {
    const auto context = [&](std::uint32_t bits, std::uint32_t most) {
      return (bits < most ? bits & ~1u : most) + (single ? 1u : 0u);
    };
    const auto minus = [](std::int32_t a, std::int32_t b) {
      return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) - static_cast<std::uint32_t>(b));
    };
    xs.encode(to, x_medians[kind].get(), minus(next.x, last.x), single ? 1 : 0);
    x_medians[kind].add(minus(next.x, last.x));
    ys.encode(to, y_medians[kind].get(), minus(next.y, last.y), context(xs.last_bits(), 20));
    y_medians[kind].add(minus(next.y, last.y));
    zs.encode(z_to, heights[level], next.z, context((xs.last_bits() + ys.last_bits()) / 2, 18));
    heights[level] = next.z;
  }
};

GridPosition grid(Bytes record) {
  ByteReader in(record);
  GridPosition at;
  at.x = in.i32();
  at.y = in.i32();
  at.z = in.i32();
  return at;
}
Colour colour(Bytes record) {
  ByteReader in(record);
  return read_colour(in);
}
Wavepacket wavepacket(Bytes record) {
  ByteReader in(record);
  return read_wavepacket(in);
}

// ---- pointwise

struct Points10 {
  SymbolModel changed{64};
  ModelSet returns{256, 256}, classes{256, 256}, user_datas{256, 256}, angles{2, 256};
  NumberEncoder intensities{16, 4}, sources{16, 1};
  std::array<std::uint32_t, kReturnKindsOf8> intensity{};
  Positions positions{kReturnKindsOf8, 0};
  bool first = true;
  void encode(ArithmeticEncoder& to, Bytes last, Bytes next) {
    const std::uint32_t r = u8_at(next, 14), number = r & 7u, count = r >> 3 & 7u;
    const std::size_t kind = return_kind_of_8(count, number);
    std::uint32_t bits = u8_at(last, 14) != r ? 32u : 0u;
    // Where nothing else changed, the decoder keeps the last intensity instead of looking at its kind's.
    const std::uint32_t last_intensity = first ? 0 : u16_at(last, 12);
    first = false;
    if (u8_at(last, 15) != u8_at(next, 15)) bits |= 8u;
    if (u8_at(last, 16) != u8_at(next, 16)) bits |= 4u;
    if (u8_at(last, 17) != u8_at(next, 17)) bits |= 2u;
    if (u16_at(last, 18) != u16_at(next, 18)) bits |= 1u;
    if (u16_at(next, 12) != intensity[kind] || (bits == 0 && u16_at(next, 12) != last_intensity)) bits |= 16u;
    to.symbol(changed, bits);
    if ((bits & 32u) != 0) to.symbol(returns[u8_at(last, 14)], r);
    if ((bits & 16u) != 0)
      intensities.encode(to, static_cast<std::int32_t>(intensity[kind]),
                         static_cast<std::int32_t>(u16_at(next, 12)), std::min<std::size_t>(kind, 3));
    intensity[kind] = u16_at(next, 12);
    if ((bits & 8u) != 0) to.symbol(classes[u8_at(last, 15)], u8_at(next, 15));
    if ((bits & 4u) != 0) to.symbol(angles[r >> 6 & 1u], (u8_at(next, 16) - u8_at(last, 16)) & 255u);
    if ((bits & 2u) != 0) to.symbol(user_datas[u8_at(last, 17)], u8_at(next, 17));
    if ((bits & 1u) != 0)
      sources.encode(to, static_cast<std::int32_t>(u16_at(last, 18)),
                     static_cast<std::int32_t>(u16_at(next, 18)));
    positions.encode(to, to, kind, return_level(count, number), count == 1, grid(last), grid(next));
  }
};

std::vector<std::byte> encode_pointwise(const Compression& how, Bytes points) {
  ArithmeticEncoder to;
  Points10 tens;
  std::optional<GpsTimes> times;
  Colours colours;
  Wavepackets packets;
  const std::size_t n = points.size() / how.point_bytes;
  ModelSet extra(how.point_bytes, 256);
  for (std::size_t i = 1; i < n; ++i) {
    std::size_t at = 0;
    for (const Item& item : how.items) {
      const Bytes last = points.subspan((i - 1) * how.point_bytes + at, item.bytes);
      const Bytes next = points.subspan(i * how.point_bytes + at, item.bytes);
      if (item.type == ItemType::kPoint10) tens.encode(to, last, next);
      if (item.type == ItemType::kGpsTime11) {
        if (!times) times.emplace(true, ByteReader(last).u64());
        times->encode(to, ByteReader(next).u64());
      }
      if (item.type == ItemType::kColour12) colours.encode(to, colour(last), colour(next));
      if (item.type == ItemType::kWavepacket13) packets.encode(to, wavepacket(last), wavepacket(next));
      for (std::size_t b = 0; item.type == ItemType::kBytes && b < item.bytes; ++b)
        to.symbol(extra[b], (u8_at(next, b) - u8_at(last, b)) & 255u);
      at += item.bytes;
    }
  }
  std::vector<std::byte> out(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(how.point_bytes));
  const std::vector<std::byte> stream = to.finish();
  out.insert(out.end(), stream.begin(), stream.end());
  return out;
}

// ---- layered

struct Channel14 {
  explicit Channel14(Bytes first)
      : last(first.begin(), first.end()),
        positions(2 * kReturnKindsOf16, grid(first).z),
        times(false, ByteReader(first.subspan(22)).u64()) {
    intensity.fill(u16_at(first, 12));
  }
  std::vector<std::byte> last;
  bool time_changed = false;
  ModelSet changes{8, 128}, counts{16, 16}, numbers{16, 16}, classes{64, 256}, flags{64, 64},
      user_datas{64, 256};
  SymbolModel channels{3}, number_steps{13};
  Positions positions;
  NumberEncoder intensities{16, 4}, angles{16, 2}, sources{16, 1};
  std::array<std::uint32_t, 8> intensity{};
  GpsTimes times;
};

std::uint32_t channel_of(Bytes point) {
  return u8_at(point, 15) >> 4 & 3u;
}

struct Points14 {
  enum Layer { kXy, kZ, kClass, kFlags, kIntensity, kAngle, kUserData, kSource, kTimes, kLayers };
  std::array<ArithmeticEncoder, kLayers> to;
  std::array<bool, kLayers> used{true};
  std::array<std::unique_ptr<Channel14>, 4> channels;
  std::uint32_t channel = 0;

  void encode(Bytes next) {
    Channel14& before = *channels[channel];
    const std::uint32_t to_channel = channel_of(next);
    if (!channels[to_channel]) channels[to_channel] = std::make_unique<Channel14>(before.last);
    Channel14& c = *channels[to_channel];
    const Bytes last = c.last;
    const std::uint32_t r = u8_at(next, 14) & 15u, n = u8_at(next, 14) >> 4;
    const std::uint32_t last_r = u8_at(last, 14) & 15u, last_n = u8_at(last, 14) >> 4;
    const bool time = ByteReader(next.subspan(22)).u64() != ByteReader(last.subspan(22)).u64();
    const bool source = u16_at(next, 20) != u16_at(last, 20), angle = u16_at(next, 18) != u16_at(last, 18);
    const std::uint32_t how = r == last_r               ? 0u
                              : r == (last_r + 1) % 16  ? 1u
                              : r == (last_r + 15) % 16 ? 2u
                                                        : 3u;
    const std::uint32_t bits = (to_channel != channel ? 64u : 0u) | (source ? 32u : 0u) | (time ? 16u : 0u) |
                               (angle ? 8u : 0u) | (n != last_n ? 4u : 0u) | how;
    const std::uint32_t before_r = u8_at(before.last, 14) & 15u, before_n = u8_at(before.last, 14) >> 4;
    to[kXy].symbol(before.changes[(before_r == 1 ? 1u : 0u) + (before_r >= before_n ? 2u : 0u) +
                                  (before.time_changed ? 4u : 0u)],
                   bits);
    if (to_channel != channel) to[kXy].symbol(before.channels, (to_channel + 4 - channel) % 4 - 1);
    channel = to_channel;
    if (n != last_n) to[kXy].symbol(c.counts[last_n], n);
    if (how == 3 && time) to[kXy].symbol(c.numbers[last_r], r);
    if (how == 3 && !time) to[kXy].symbol(c.number_steps, (r + 16 - last_r) % 16 - 2);
    c.positions.encode(to[kXy], to[kZ], 2 * return_kind_of_16(n, r) + (time ? 1 : 0), return_level(n, r),
                       n == 1, grid(last), grid(next));
    const std::size_t place = (r == 1 ? 2u : 0u) + (r >= n ? 1u : 0u);
    to[kClass].symbol(c.classes[(u8_at(last, 16) & 31u) * 2 + (place == 3 ? 1 : 0)], u8_at(next, 16));
    const auto flags = [](Bytes p) { return (u8_at(p, 15) & 15u) | (u8_at(p, 15) >> 2 & 0x30u); };
    to[kFlags].symbol(c.flags[flags(last)], flags(next));
    std::uint32_t& intensity = c.intensity[2 * place + (time ? 1 : 0)];
    c.intensities.encode(to[kIntensity], static_cast<std::int32_t>(intensity),
                         static_cast<std::int32_t>(u16_at(next, 12)), place);
    intensity = u16_at(next, 12);
    const auto angle_at = [](Bytes p) { return static_cast<std::int16_t>(u16_at(p, 18)); };
    if (angle) c.angles.encode(to[kAngle], angle_at(last), angle_at(next), time ? 1 : 0);
    to[kUserData].symbol(c.user_datas[u8_at(last, 17) / 4], u8_at(next, 17));
    if (source)
      c.sources.encode(to[kSource], static_cast<std::int32_t>(u16_at(last, 20)),
                       static_cast<std::int32_t>(u16_at(next, 20)));
    if (time) c.times.encode(to[kTimes], ByteReader(next.subspan(22)).u64());
    used[kZ] |= grid(last).z != grid(next).z;
    used[kClass] |= u8_at(last, 16) != u8_at(next, 16);
    used[kFlags] |= flags(last) != flags(next);
    used[kIntensity] |= u16_at(last, 12) != u16_at(next, 12);
    used[kAngle] |= angle;
    used[kUserData] |= u8_at(last, 17) != u8_at(next, 17);
    used[kSource] |= source;
    used[kTimes] |= time;
    c.time_changed = time;
    c.last.assign(next.begin(), next.end());
  }
};

// Models and the last record of the other items, by channel; `mended`: of version 4 (layered_items.cpp).
template <class Models>
struct Channels14 {
  bool mended = false;
  std::array<std::optional<Models>, 4> models{};
  std::array<std::vector<std::byte>, 4> last{};
  std::uint32_t channel = 0;
  template <class Encode>
  void encode(std::uint32_t to_channel, Bytes next, const Models& fresh, Encode&& code) {
    std::uint32_t from = channel;
    if (to_channel != channel) {
      if (!models[to_channel]) {
        models[to_channel] = fresh;
        last[to_channel] = last[channel];
        from = to_channel;
      } else if (mended) {
        from = to_channel;
      }
      channel = to_channel;
    }
    code(*models[channel], Bytes(last[from]));
    last[from].assign(next.begin(), next.end());
  }
};

std::vector<std::byte> encode_layered(const Compression& how, Bytes points) {
  const std::size_t n = points.size() / how.point_bytes;
  std::vector<std::byte> out(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(how.point_bytes));
  std::vector<std::vector<std::byte>> layers;
  const std::uint32_t first_channel = channel_of(points);
  std::size_t at = 0;
  // Runs over the points of an item of `Models`, each layer one stream.
  const auto run = [&](const Item& item, std::size_t count, auto fresh, auto&& code) {
    Channels14<decltype(fresh)> channels;
    channels.mended = item.version >= 4;
    channels.channel = first_channel;
    channels.models[first_channel] = fresh;
    const Bytes first = points.subspan(at, item.bytes);
    channels.last[first_channel].assign(first.begin(), first.end());
    std::vector<ArithmeticEncoder> to(count);
    std::vector<bool> used(count, false);
    for (std::size_t i = 1; i < n; ++i) {
      const Bytes next = points.subspan(i * how.point_bytes + at, item.bytes);
      channels.encode(channel_of(points.subspan(i * how.point_bytes)), next, fresh,
                      [&](auto& models, Bytes last) { code(to, used, models, last, next); });
    }
    for (std::size_t l = 0; l < count; ++l)
      layers.push_back(used[l] ? to[l].finish() : std::vector<std::byte>());
  };
  struct ColourModels {
    Colours colours;
    Infrareds infrareds;
  };
  for (const Item& item : how.items) {
    if (item.type == ItemType::kPoint14) {
      Points14 points14;
      points14.channel = first_channel;
      points14.channels[first_channel] = std::make_unique<Channel14>(points.first(30));
      for (std::size_t i = 1; i < n; ++i) points14.encode(points.subspan(i * how.point_bytes, 30));
      for (std::size_t l = 0; l < Points14::kLayers; ++l)
        layers.push_back(points14.used[l] ? points14.to[l].finish() : std::vector<std::byte>());
    } else if (item.type == ItemType::kColour14 || item.type == ItemType::kColourInfrared14) {
      const bool infrared = item.type == ItemType::kColourInfrared14;
      run(item, infrared ? 2 : 1, ColourModels(),
          [&](auto& to, auto& used, ColourModels& models, Bytes last, Bytes next) {
            models.colours.encode(to[0], colour(last), colour(next));
            used[0] = used[0] || !std::equal(last.begin(), last.begin() + 6, next.begin());
            if (!infrared) return;
            models.infrareds.encode(to[1], u16_at(last, 6), u16_at(next, 6));
            used[1] = used[1] || u16_at(last, 6) != u16_at(next, 6);
          });
    } else if (item.type == ItemType::kWavepacket14) {
      run(item, 1, Wavepackets(), [&](auto& to, auto& used, Wavepackets& models, Bytes last, Bytes next) {
        models.encode(to[0], wavepacket(last), wavepacket(next));
        used[0] = used[0] || !std::equal(last.begin(), last.end(), next.begin());
      });
    } else {
      run(item, item.bytes, ModelSet(item.bytes, 256),
          [&](auto& to, auto& used, ModelSet& models, Bytes last, Bytes next) {
            for (std::size_t b = 0; b < item.bytes; ++b) {
              to[b].symbol(models[b], (u8_at(next, b) - u8_at(last, b)) & 255u);
              used[b] = used[b] || next[b] != last[b];
            }
          });
    }
    at += item.bytes;
  }
  const auto put = [&](std::size_t value) {
    std::array<std::byte, 4> bytes{};
    ByteWriter(bytes).u32(static_cast<std::uint32_t>(value));
    out.insert(out.end(), bytes.begin(), bytes.end());
  };
  put(n);
  for (const auto& layer : layers) put(layer.size());
  for (const auto& layer : layers) out.insert(out.end(), layer.begin(), layer.end());
  return out;
}

}  // namespace

std::vector<std::byte> encode_chunk(const Compression& how, std::span<const std::byte> points) {
  return how.layered ? encode_layered(how, points) : encode_pointwise(how, points);
}

}  // namespace palpate::laz::test
