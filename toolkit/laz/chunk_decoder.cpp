#include "toolkit/laz/chunk_decoder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cstring>
#include <utility>

#include "toolkit/core/bytes.h"
#include "toolkit/laz/arithmetic_decoder.h"
#include "toolkit/laz/field_decoders.h"

namespace palpate::laz {

// ---- compression and the table of chunks

namespace {

constexpr std::uint16_t kPointwise = 1, kPointwiseChunked = 2, kLayeredChunked = 3;
constexpr std::uint16_t kArithmeticCoder = 0;
constexpr std::uint32_t kVariableChunks = 0xFFFFFFFFu;
constexpr std::size_t kItemBytes = 6;
// The most points that a byte can hold. However often a symbol came, the others keep 2^-15 each, so that a
// point with nothing new costs 63 of them and then 3 times 32 (pointwise: what changed, lengths of x, y and
// z), or 127 and twice 32 (layered): at least 0.007 bits.
constexpr std::uint64_t kMostPointsPerByte = 1200;
constexpr const char* kConvertRemedy =
    "compress it anew: laszip -i in.laz -o out.las, then laszip -i out.las";

// Requirements of an item: its bytes (0: any), and the versions that are read.
struct ItemRow {
  ItemType type;
  const char* name;
  std::size_t bytes;
  std::uint32_t first_version, last_version;
  bool layered;
};
constexpr std::size_t kPoint10Bytes = 20, kPoint14Bytes = 30, kTimeBytes = 8, kColourInfraredBytes = 8;
constexpr ItemRow kItems[] = {
    {ItemType::kBytes, "BYTE", 0, 2, 2, false},
    {ItemType::kPoint10, "POINT10", kPoint10Bytes, 2, 2, false},
    {ItemType::kGpsTime11, "GPSTIME11", kTimeBytes, 2, 2, false},
    {ItemType::kColour12, "RGB12", kColourBytes, 2, 2, false},
    {ItemType::kWavepacket13, "WAVEPACKET13", kWavepacketBytes, 1, 2, false},
    {ItemType::kPoint14, "POINT14", kPoint14Bytes, 3, 4, true},
    {ItemType::kColour14, "RGB14", kColourBytes, 3, 4, true},
    {ItemType::kColourInfrared14, "RGBNIR14", kColourInfraredBytes, 3, 4, true},
    {ItemType::kWavepacket14, "WAVEPACKET14", kWavepacketBytes, 3, 4, true},
    {ItemType::kBytes14, "BYTE14", 0, 3, 4, true},
};

Result<Item> check_item(std::uint16_t type, std::uint16_t bytes, std::uint16_t version, bool layered,
                        std::uint64_t at) {
  const auto* const row = std::find_if(std::begin(kItems), std::end(kItems), [&](const ItemRow& known) {
    return static_cast<std::uint16_t>(known.type) == type;
  });
  if (row == std::end(kItems))
    return Error{fmt::format("the LASzip item at byte {} has the unknown type {}", at, type), kConvertRemedy};
  if (row->layered != layered)
    return Error{
        fmt::format("the LASzip item {} at byte {} does not go with the file's compressor", row->name, at),
        kConvertRemedy};
  if (version < row->first_version || version > row->last_version)
    return Error{fmt::format("version {} of the LASzip item {} (at byte {}) is not read, only {} to {}",
                             version, row->name, at, row->first_version, row->last_version),
                 kConvertRemedy};
  if (bytes == 0 || (row->bytes != 0 && row->bytes != bytes))
    return Error{fmt::format("the LASzip item {} at byte {} has {} bytes, it should have {}", row->name, at,
                             bytes, row->bytes == 0 ? "one or more" : std::to_string(row->bytes)),
                 kFetchAgain};
  return Item{row->type, bytes, version};
}

}  // namespace

Result<Compression> read_compression(std::span<const std::byte> record, std::uint64_t at,
                                     std::size_t point_bytes, bool with_layers) {
  ByteReader in(record);
  const std::uint16_t compressor = in.u16(), coder = in.u16();
  (void)in.u32();  // LASzip's version
  (void)in.u32();  // options, none of which concern reading
  const std::uint32_t chunk_points = in.u32();
  (void)in.u64();  // special EVLRs, never used
  (void)in.u64();
  const std::uint16_t items = in.u16();
  if (!in.good() || in.left() < kItemBytes * items)
    return Error{fmt::format("the LASzip record at byte {} has {} bytes, too few for its {} items", at,
                             record.size(), items),
                 kFetchAgain};
  if (compressor == kPointwise)
    return Error{
        fmt::format("the file is compressed without chunks (compressor {}, at byte {}), as LASzip did "
                    "before 2011; that is not read",
                    compressor, at),
        kConvertRemedy};
  if ((compressor != kPointwiseChunked && compressor != kLayeredChunked) || coder != kArithmeticCoder)
    return Error{
        fmt::format("the file's compressor {} with coder {} (at byte {}) is unknown", compressor, coder, at),
        kConvertRemedy};
  Compression how;
  how.layered = compressor == kLayeredChunked;
  if (how.layered != with_layers)
    return Error{
        fmt::format("the compressor {} at byte {} does not go with the file's point format", compressor, at),
        kConvertRemedy};
  how.chunk_points = chunk_points == kVariableChunks ? 0 : chunk_points;
  if (chunk_points == 0)
    return Error{fmt::format("the LASzip record at byte {} promises chunks of 0 points", at), kFetchAgain};
  for (std::uint16_t i = 0; i < items; ++i) {
    const std::uint64_t item_at = at + in.at();
    const std::uint16_t type = in.u16(), bytes = in.u16(), version = in.u16();
    PALPATE_ASSIGN(const Item item, check_item(type, bytes, version, how.layered, item_at));
    how.items.push_back(item);
    how.point_bytes += item.bytes;
  }
  const ItemType first = how.layered ? ItemType::kPoint14 : ItemType::kPoint10;
  const auto firsts =
      std::count_if(how.items.begin(), how.items.end(), [&](const Item& item) { return item.type == first; });
  if (firsts != 1 || how.items.front().type != first || how.point_bytes != point_bytes)
    return Error{fmt::format("the items of the LASzip record at byte {} make points of {} bytes, the header "
                             "promises {}",
                             at, how.point_bytes, point_bytes),
                 kFetchAgain};
  return how;
}

Result<std::uint32_t> read_chunk_count(std::span<const std::byte> start, const Compression& how,
                                       std::uint64_t first_chunk, std::uint64_t table_at) {
  ByteReader in(start);
  const std::uint32_t version = in.u32(), chunks = in.u32();
  if (!in.good() || version != 0)
    return Error{fmt::format("the table of chunks at byte {} has the unknown version {}", table_at, version),
                 kFetchAgain};
  // Every chunk begins with a whole point.
  const std::uint64_t most = table_at > first_chunk ? (table_at - first_chunk) / how.point_bytes : 0;
  if (chunks > most)
    return Error{fmt::format("the table of chunks at byte {} promises {} chunks, but there are only {} bytes "
                             "for them",
                             table_at, chunks, table_at - std::min(first_chunk, table_at)),
                 kFetchAgain};
  return chunks;
}

Result<std::vector<Chunk>> read_chunk_table(std::span<const std::byte> table, std::uint32_t chunks,
                                            const Compression& how, std::uint64_t first_chunk,
                                            std::uint64_t table_at, std::uint64_t points) {
  enum Context : std::size_t { kPointCounts, kByteCounts };
  std::vector<Chunk> found;
  if (points == 0) return found;
  ArithmeticDecoder decoder(table);
  NumberDecoder numbers(32, 2);
  std::int32_t last_points = 0, last_bytes = 0;
  std::uint64_t at = first_chunk, left = points;
  for (std::uint32_t i = 0; i < chunks && left > 0; ++i) {
    Chunk chunk;
    if (how.chunk_points == 0) {
      last_points = numbers.decode(decoder, last_points, kPointCounts);
      chunk.points = static_cast<std::uint32_t>(last_points);
    } else {
      chunk.points = std::min<std::uint64_t>(how.chunk_points, left);
    }
    last_bytes = numbers.decode(decoder, last_bytes, kByteCounts);
    chunk.bytes = static_cast<std::uint32_t>(last_bytes);
    chunk.at = at;
    if (decoder.damaged() || chunk.bytes > table_at - at)
      return Error{fmt::format("the table of chunks at byte {} is damaged: chunk {} at byte {} would have {} "
                               "bytes",
                               table_at, i + 1, at, chunk.bytes),
                   kFetchAgain};
    if (chunk.points > 1 + kMostPointsPerByte * chunk.bytes)
      return Error{fmt::format("the chunk of {} bytes at byte {} cannot hold the {} points that it promises",
                               chunk.bytes, at, chunk.points),
                   kFetchAgain};
    at += chunk.bytes;
    left -= std::min(left, chunk.points);
    if (chunk.points > 0) found.push_back(chunk);
  }
  if (left > 0)
    return Error{fmt::format("the table of chunks at byte {} holds {} of the {} promised points", table_at,
                             points - left, points),
                 kFetchAgain};
  return found;
}

// ---- one chunk

namespace {

// Points between two checks of the streams: a chunk that ended early is not decoded to its promise.
constexpr std::uint64_t kPointsPerCheck = 4096;

}  // namespace

Error ChunkDecoder::damaged() const {
  return Error{
      fmt::format("the chunk of {} bytes at byte {} is damaged between its points {} and {}", chunk_.bytes,
                  chunk_.at, decoded_ > kPointsPerCheck ? decoded_ - kPointsPerCheck : 1,
                  std::max<std::uint64_t>(decoded_, 1)),
      kFetchAgain};
}

Result<ChunkDecoder> ChunkDecoder::open(const Compression& how, const Chunk& chunk,
                                        std::vector<std::byte> bytes) {
  ChunkDecoder decoder;
  decoder.chunk_ = chunk;
  decoder.bytes_ = std::move(bytes);
  decoder.point_bytes_ = how.point_bytes;
  for (const Item& item : how.items) decoder.item_bytes_.push_back(item.bytes);
  if (decoder.bytes_.size() < how.point_bytes)
    return Error{fmt::format("the chunk at byte {} has {} bytes, less than a point", chunk.at, chunk.bytes),
                 kFetchAgain};
  PALPATE_TRY(how.layered ? decoder.open_layered(how) : decoder.open_pointwise(how));
  return decoder;
}

Status ChunkDecoder::open_pointwise(const Compression& how) {
  ByteReader in(bytes_);
  for (const Item& item : how.items) {
    pointwise_.push_back(make_pointwise(item));
    pointwise_.back()->begin(in.raw(item.bytes));
  }
  if (chunk_.points > 1) stream_ = ArithmeticDecoder(std::span(bytes_).subspan(point_bytes_));
  return Done{};
}

Status ChunkDecoder::open_layered(const Compression& how) {
  ByteReader in(bytes_);
  (void)in.raw(point_bytes_);
  const std::uint32_t points = in.u32();
  if (!in.good() || points != chunk_.points)
    return Error{fmt::format("the chunk at byte {} says that it has {} points, its file {}", chunk_.at,
                             points, chunk_.points),
                 kFetchAgain};
  std::vector<std::uint32_t> sizes;
  for (const Item& item : how.items) {
    layered_.push_back(make_layered(item));
    for (std::size_t i = 0; i < layered_.back()->layers(); ++i) sizes.push_back(in.u32());
  }
  ByteReader first(bytes_);
  std::size_t layer = 0;
  for (std::size_t i = 0; i < layered_.size(); ++i) {
    std::vector<std::span<const std::byte>> layers(layered_[i]->layers());
    for (std::span<const std::byte>& stream : layers) stream = in.raw(sizes[layer++]);
    layered_[i]->begin(first.raw(item_bytes_[i]), layers, channel_);
  }
  if (!in.good())
    return Error{fmt::format("the layers of the chunk at byte {} do not fit into its {} bytes", chunk_.at,
                             chunk_.bytes),
                 kFetchAgain};
  return Done{};
}

Status ChunkDecoder::decode(std::span<std::byte> points) {
  assert(points.size() % point_bytes_ == 0 && points.size() / point_bytes_ <= points_left());
  while (!points.empty()) {
    bool possible = true;
    if (decoded_ == 0) {
      std::memcpy(points.data(), bytes_.data(), point_bytes_);
    } else {
      std::span<std::byte> rest = points;
      for (std::size_t i = 0; i < item_bytes_.size(); ++i) {
        const std::span<std::byte> record = rest.first(item_bytes_[i]);
        possible = (pointwise_.empty() ? layered_[i]->next(record, channel_)
                                       : pointwise_[i]->next(stream_, record)) &&
                   possible;
        rest = rest.subspan(item_bytes_[i]);
      }
    }
    points = points.subspan(point_bytes_);
    ++decoded_;
    if (possible && !points.empty() && decoded_ % kPointsPerCheck != 0) continue;
    const bool sound = decoded_ == 1 ||
                       (!stream_.damaged() && std::none_of(layered_.begin(), layered_.end(),
                                                           [](const auto& item) { return item->damaged(); }));
    if (!possible || !sound) return damaged();
  }
  return Done{};
}

}  // namespace palpate::laz
