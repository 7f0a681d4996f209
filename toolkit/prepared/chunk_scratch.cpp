#include "toolkit/prepared/chunk_scratch.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "toolkit/core/bytes.h"
#include "toolkit/core/hardware.h"
#include "toolkit/core/hash.h"

namespace palpate::prepared {

namespace {

using spline_sdf::Brick;
using spline_sdf::BrickGrid;
using spline_sdf::BrickTile;
using spline_sdf::ChunkBrick;
using spline_sdf::PlacedBrick;
using spline_sdf::SurfaceChunk;
using spline_sdf::TileCoder;
using spline_sdf::TileKey;
using spline_sdf::TileSink;

/// First code, numbers of own, rim and seam bricks, of pieces and tiles, bytes of these, sums of distances,
/// patches.
constexpr std::size_t kChunkHeadBytes = 10 * sizeof(std::uint64_t);
constexpr std::size_t kChunkBrickBytes = 8 + 4 + 4 + 6 * 4;
/// The length before a record and the hash after it.
constexpr std::size_t kRecordEdgeBytes = sizeof(std::uint64_t);

void write_chunk_brick(const ChunkBrick& one, ByteWriter& to) {
  to.u64(one.code);
  to.u8(static_cast<std::uint8_t>(one.level));
  to.u8(one.summary.cells);
  to.u8(one.summary.beyond);
  to.u8(one.summary.smaller ? 1 : 0);
  to.u32(one.summary.piece);
  for (int a = 0; a < 3; ++a) to.single(one.summary.part.middle[a]);
  for (int a = 0; a < 3; ++a) to.single(one.summary.part.area[a]);
}

void read_chunk_brick(ByteReader& from, ChunkBrick& one) {
  one.code = from.u64();
  one.level = from.u8();
  one.summary.cells = from.u8();
  one.summary.beyond = from.u8();
  one.summary.smaller = from.u8() != 0;
  one.summary.piece = from.u32();
  for (int a = 0; a < 3; ++a) one.summary.part.middle[a] = from.single();
  for (int a = 0; a < 3; ++a) one.summary.part.area[a] = from.single();
}

std::uint64_t hash_of_record(std::span<const std::byte> bytes) noexcept {
  Hash64 hash;
  hash.bytes(bytes);
  return hash.value();
}

/// A chunk as its record, all but the bricks' images, which follow.
std::vector<std::byte> encode_chunk(const SurfaceChunk& chunk,
                                    std::span<const std::vector<std::byte>> images) {
  std::size_t packed = 0;
  for (const std::vector<std::byte>& image : images) packed += image.size();
  std::vector<std::byte> bytes(
      kChunkHeadBytes + (chunk.groups.size() + images.size()) * sizeof(std::uint32_t) +
      (chunk.rim.size() + chunk.seam.size() + chunk.own.size()) * kChunkBrickBytes + packed);
  ByteWriter to{std::span(bytes)};
  to.u64(chunk.first_code);
  to.u64(chunk.own.size());
  to.u64(chunk.rim.size());
  to.u64(chunk.seam.size());
  to.u64(chunk.groups.size());
  to.u64(images.size());
  to.u64(packed);
  to.u64(chunk.distances.squares);
  to.u64(chunk.distances.count);
  to.u64(chunk.patches);
  for (const std::uint32_t group : chunk.groups) to.u32(group);
  for (const std::vector<std::byte>& image : images) to.u32(static_cast<std::uint32_t>(image.size()));
  for (const auto* bricks : {&chunk.rim, &chunk.seam, &chunk.own})
    for (const ChunkBrick& one : *bricks) write_chunk_brick(one, to);
  for (const std::vector<std::byte>& image : images) to.raw(image);
  return bytes;
}

/// All but the bricks, of bytes whose hash was right; `tiles`: bytes of each. False where they are not as
/// many as they say.
bool decode_chunk(std::span<const std::byte> bytes, SurfaceChunk& chunk, std::vector<std::uint32_t>& tiles) {
  ByteReader from(bytes);
  chunk.first_code = from.u64();
  const std::uint64_t own = from.u64(), rim = from.u64(), seam = from.u64(), groups = from.u64();
  const std::uint64_t images = from.u64(), packed = from.u64();
  const std::uint64_t most = bytes.size();  // each takes more than one, so that the sum below cannot overflow
  if (own > most || rim > most || seam > most || groups > most || images > most || packed > most ||
      kChunkHeadBytes + (groups + images) * sizeof(std::uint32_t) + (own + rim + seam) * kChunkBrickBytes +
              packed !=
          most)
    return false;
  chunk.own.resize(static_cast<std::size_t>(own));
  chunk.rim.resize(static_cast<std::size_t>(rim));
  chunk.seam.resize(static_cast<std::size_t>(seam));
  chunk.groups.resize(static_cast<std::size_t>(groups));
  chunk.distances.squares = from.u64();
  chunk.distances.count = from.u64();
  chunk.patches = from.u64();
  for (std::uint32_t& group : chunk.groups) group = from.u32();
  tiles.resize(static_cast<std::size_t>(images));
  for (std::uint32_t& tile : tiles) tile = from.u32();
  if (std::accumulate(tiles.begin(), tiles.end(), std::uint64_t{0}) != packed) return false;
  for (auto* bricks : {&chunk.rim, &chunk.seam, &chunk.own})
    for (ChunkBrick& one : *bricks) read_chunk_brick(from, one);
  const auto is_numbered = [&](const ChunkBrick& one) {
    return one.summary.piece < groups && one.level < spline_sdf::BrickGrid::kMaxLevels;
  };
  return std::all_of(chunk.own.begin(), chunk.own.end(), is_numbered) &&
         std::all_of(chunk.rim.begin(), chunk.rim.end(), is_numbered) &&
         std::all_of(chunk.seam.begin(), chunk.seam.end(), is_numbered);
}

}  // namespace

Result<ChunkScratch> ChunkScratch::open(const std::string& path, std::uint64_t key,
                                        const BrickGrid& lattice) {
  PALPATE_ASSIGN(PartFile file, PartFile::open(path));
  PALPATE_ASSIGN(const std::uint64_t size, file.size());
  ChunkScratch out(std::move(file), lattice);
  out.lattice_.levels = lattice.coarser + spline_sdf::BrickGrid::kFineLevels;
  std::array<std::byte, sizeof(std::uint64_t)> first{};
  if (size >= first.size()) PALPATE_TRY(out.file_.read_at(0, first));
  if (size < first.size() || ByteReader{std::span<const std::byte>(first)}.u64() != key) {
    PALPATE_TRY(out.begin_anew(key));
    return out;
  }
  out.end_ = first.size();
  for (bool more = true; more;) {
    PALPATE_ASSIGN(more, out.read_record(size));
  }
  PALPATE_TRY(out.file_.resize(out.end_));
  return out;
}

Status ChunkScratch::begin_anew(std::uint64_t key) {
  PALPATE_TRY(file_.resize(0));
  std::array<std::byte, sizeof(std::uint64_t)> first{};
  ByteWriter{std::span<std::byte>(first)}.u64(key);
  PALPATE_TRY(file_.write_at(0, first));
  end_ = first.size();
  return Done{};
}

Result<bool> ChunkScratch::read_record(std::uint64_t file_size) {
  if (file_size - end_ < 2 * kRecordEdgeBytes) return false;
  std::array<std::byte, kRecordEdgeBytes> edge{};
  PALPATE_TRY(file_.read_at(end_, edge));
  const std::uint64_t length = ByteReader{std::span<const std::byte>(edge)}.u64();
  if (length > file_size - end_ - 2 * kRecordEdgeBytes) return false;
  std::vector<std::byte> bytes(static_cast<std::size_t>(length));
  PALPATE_TRY(file_.read_at(end_ + kRecordEdgeBytes, bytes));
  PALPATE_TRY(file_.read_at(end_ + kRecordEdgeBytes + length, edge));
  if (ByteReader{std::span<const std::byte>(edge)}.u64() != hash_of_record(bytes)) return false;
  SurfaceChunk chunk;
  std::vector<std::uint32_t> tiles;
  if (!decode_chunk(bytes, chunk, tiles)) return false;
  keep(std::move(chunk), tiles, length);
  return true;
}

Status ChunkScratch::add(SurfaceChunk chunk) {
  std::vector<std::vector<std::byte>> images;
  std::vector<std::uint32_t> sizes;
  TileCoder coder;
  std::vector<Brick> bricks;
  PALPATE_TRY(cut(chunk.own, [&](const BrickTile& tile) -> Status {
    bricks.clear();
    for (const std::uint32_t number : tile.bricks) bricks.push_back(chunk.bricks[number]);
    PALPATE_ASSIGN(std::vector<std::byte> image, coder.pack(tile, bricks));
    sizes.push_back(static_cast<std::uint32_t>(image.size()));
    images.push_back(std::move(image));
    return Done{};
  }));
  const std::vector<std::byte> bytes = encode_chunk(chunk, images);
  std::array<std::byte, kRecordEdgeBytes> edge{};
  ByteWriter{std::span<std::byte>(edge)}.u64(bytes.size());
  PALPATE_TRY(file_.write_at(end_, edge));
  PALPATE_TRY(file_.write_at(end_ + kRecordEdgeBytes, bytes));
  ByteWriter{std::span<std::byte>(edge)}.u64(hash_of_record(bytes));
  PALPATE_TRY(file_.write_at(end_ + kRecordEdgeBytes + bytes.size(), edge));
  keep(std::move(chunk), sizes, bytes.size());
  return Done{};
}

void ChunkScratch::keep(SurfaceChunk chunk, std::span<const std::uint32_t> tiles,
                        std::uint64_t record_bytes) {
  end_ += 2 * kRecordEdgeBytes + record_bytes;
  Place& place = places_.emplace_back();
  place.counts = spline_sdf::level_counts(chunk);
  std::uint64_t at = end_ - kRecordEdgeBytes;
  place.tiles_at.assign(tiles.size() + 1, at);
  for (std::size_t tile = tiles.size(); tile-- > 0;) place.tiles_at[tile] = at -= tiles[tile];
  place.own_at = at - chunk.own.size() * kChunkBrickBytes;
  release_memory(chunk.bricks);
  release_memory(chunk.own);
  chunk.rim.shrink_to_fit();
  chunk.seam.shrink_to_fit();
  chunks_.push_back(std::move(chunk));
}

Status ChunkScratch::read_own(std::size_t chunk, std::size_t first, std::size_t count,
                              std::vector<ChunkBrick>& out) const {
  std::vector<std::byte> bytes(count * kChunkBrickBytes);
  PALPATE_TRY(file_.read_at(places_[chunk].own_at + first * kChunkBrickBytes, bytes));
  out.resize(count);
  ByteReader from(bytes);
  for (ChunkBrick& one : out) read_chunk_brick(from, one);
  return Done{};
}

std::uint64_t ChunkScratch::bricks() const noexcept {
  std::uint64_t bricks = 0;
  for (const Place& place : places_)
    bricks = std::accumulate(place.counts.begin(), place.counts.end(), bricks);
  return bricks;
}

Status ChunkScratch::cut(std::span<const ChunkBrick> own, const VisitTile& tile) const {
  std::vector<PlacedBrick> placed;
  placed.reserve(own.size());
  for (const ChunkBrick& one : own)
    placed.push_back(
        {{one.code, depth_of_level(lattice_, one.level)}, static_cast<std::uint32_t>(placed.size())});
  sort_placed(placed);
  const auto alone = [&](const PlacedBrick& one) {
    BrickTile only{one.key, std::vector<spline_sdf::TileNode>(spline_sdf::kGroupNodes), {one.brick}};
    only.nodes.front().brick = 0;
    return tile(only);
  };
  return cut_into_tiles({}, placed, {tile, alone});
}

Status ChunkScratch::read_tile(std::size_t chunk, std::size_t tile, TileKey key,
                               spline_sdf::SurfaceFile::TileBuffer& out) const {
  const std::vector<std::uint64_t>& at = places_[chunk].tiles_at;
  out.image.resize(static_cast<std::size_t>(at[tile + 1] - at[tile]));
  PALPATE_TRY(file_.read_at(at[tile], out.image));
  return out.coder.unpack(out.image, key, lattice_, out.tile);
}

// --- the tiles of the whole

ChunkTiles::ChunkTiles(const ChunkScratch& scratch, const BrickGrid& grid) : scratch_(scratch), grid_(grid) {
  std::uint32_t bricks = 0;
  for (std::size_t c = 0; c < scratch.chunks().size(); ++c) {
    firsts_.push_back(bricks);
    for (const std::uint32_t count : scratch.counts(c)) bricks += count;
  }
  firsts_.push_back(bricks);
}

Status ChunkTiles::read(std::uint32_t number, const spline_sdf::JoinedChunks& joined, Brick& out) {
  const auto after = std::upper_bound(firsts_.begin(), firsts_.end(), number);
  const auto chunk = static_cast<std::size_t>(after - firsts_.begin()) - 1;
  const Loaded& here = loaded_.at(chunk);
  const Loaded::Place& place = here.places[number - firsts_[chunk]];
  const std::pair<std::size_t, std::size_t> wanted{chunk, place.tile};
  if (unpacked_ != wanted) {
    unpacked_ = kNoTile;
    PALPATE_TRY(scratch_.read_tile(chunk, place.tile, here.keys[place.tile], buffer_));
    unpacked_ = wanted;
  }
  out = buffer_.tile.bricks[place.at];
  joined.pieces[chunk][place.piece].put(out);
  return Done{};
}

/// First code of a chunk among the smallest nodes.
std::uint64_t ChunkTiles::first_code(std::size_t chunk) const {
  return TileKey{scratch_.chunks()[chunk].first_code, depth_of_level(grid_, 0)}.first_code();
}

Status ChunkTiles::load(std::size_t chunk) {
  if (loaded_.contains(chunk)) return Done{};
  std::vector<ChunkBrick> own;
  PALPATE_TRY(scratch_.read_own(chunk, 0, firsts_[chunk + 1] - firsts_[chunk], own));
  Loaded& here = loaded_[chunk];
  for (const ChunkBrick& one : own) {
    here.placed.push_back({{one.code, depth_of_level(grid_, one.level)},
                           firsts_[chunk] + static_cast<std::uint32_t>(here.placed.size())});
    here.places.push_back({0, 0, one.summary.piece});
  }
  sort_placed(here.placed);
  return scratch_.cut(own, [&](const BrickTile& tile) -> Status {
    for (std::uint32_t i = 0; i < tile.bricks.size(); ++i) {
      Loaded::Place& place = here.places[tile.bricks[i]];
      place.tile = static_cast<std::uint32_t>(here.keys.size());
      place.at = i;
    }
    here.keys.push_back(tile.key);
    return Done{};
  });
}

/// The chunks that may have bricks in a node, among those of the node around it.
std::pair<std::size_t, std::size_t> ChunkTiles::chunks_in(TileKey node, std::size_t first,
                                                          std::size_t past) const {
  const std::uint64_t low = node.first_code();
  const std::uint64_t next = TileKey{node.code + 1, node.depth}.first_code();
  std::size_t a = first;
  while (a < past && first_code(a) < low) ++a;
  std::size_t b = a;
  while (b < past && first_code(b) < next) ++b;
  // Where none begins in it, the one before may go on.
  return a == b && a > first ? std::pair(a - 1, a) : std::pair(a, b);
}

Status ChunkTiles::cut(TileKey node, std::size_t first, std::size_t past, const TileSink& sink) {
  const std::uint32_t count = firsts_[past] - firsts_[first];
  if (count == 0) return Done{};
  if (past - first > 1 && count > spline_sdf::kTileBricks) {
    for (std::uint64_t k = 0; k < spline_sdf::kGroupNodes; ++k) {
      const TileKey child{node.code << 3 | k, node.depth + 1};
      const auto [a, b] = chunks_in(child, first, past);
      PALPATE_TRY(cut(child, a, b, sink));
    }
    return Done{};
  }
  if (past - first > 1 || !loaded_.contains(first)) loaded_.clear();
  std::vector<PlacedBrick> together;
  const auto before = [](const PlacedBrick& one, std::uint64_t code) { return one.key.first_code() < code; };
  for (std::size_t c = first; c < past; ++c) {
    PALPATE_TRY(load(c));
    const std::vector<PlacedBrick>& all = loaded_.at(c).placed;
    const auto from = std::lower_bound(all.begin(), all.end(), node.first_code(), before);
    const auto to =
        std::lower_bound(from, all.end(), TileKey{node.code + 1, node.depth}.first_code(), before);
    if (past - first == 1) return cut_into_tiles(node, {from, to}, sink);
    together.insert(together.end(), from, to);
  }
  return cut_into_tiles(node, together, sink);
}

}  // namespace palpate::prepared
