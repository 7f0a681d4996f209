#include <fmt/format.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstring>
#include <new>
#include <type_traits>

#include "toolkit/core/hash.h"
#include "toolkit/spline_sdf/brick_tiles.h"

namespace palpate::spline_sdf {
namespace {

/// zstd's fastest: what is left after prediction is noise, of which slower ones take a hundredth more.
constexpr int kPackLevel = 1;
/// Bytes of a brick beside its nodes: flags, piece, mask.
constexpr std::size_t kBrickHeadBytes = 1 + 2 + 8;
/// Flag of a brick whose nodes differ from those of bricks beside it: it has all of its own.
constexpr std::uint8_t kOwnNodes = 1;
/// Flags of a root: it has a brick, and children.
constexpr std::uint8_t kRootBrick = 1, kRootChildren = 2;
/// Slots for the eight blocks of each brick, so that half of them stay empty.
constexpr std::size_t kBlockSlots = 2 * 8 * kTileBricks;
constexpr int kBlockBits = std::countr_zero(kBlockSlots);
static_assert(std::has_single_bit(kBlockSlots));
/// A brick's nodes along an edge in its own block; the rest are in the next.
constexpr std::size_t kBlockEdge = 4;

/// Small numbers of either sign as small numbers without.
std::uint16_t folded(std::uint16_t difference) noexcept {
  return static_cast<std::uint16_t>((difference << 1) ^ (difference >> 15 != 0 ? 0xffff : 0));
}
std::uint16_t unfolded(std::uint16_t number) noexcept {
  return static_cast<std::uint16_t>((number >> 1) ^ ((number & 1) != 0 ? 0xffff : 0));
}

/// A brick's size and place: what tells whether two share nodes.
struct BrickPlace {
  int depth = 0;
  std::array<std::uint32_t, 3> cube{};

  bool operator==(const BrickPlace&) const = default;
  [[nodiscard]] BrickPlace child(std::uint32_t k) const noexcept {
    return {depth + 1, {cube[0] << 1 | (k & 1), cube[1] << 1 | (k >> 1 & 1), cube[2] << 1 | k >> 2}};
  }
};

/// The nodes of a brick with a border of zeros before them, and which of them are known: a bit a node of each
/// row.
struct BrickNodes {
  static constexpr std::size_t kPadded = kBrickNodes + 1;
  std::array<std::uint16_t, kPadded * kPadded * kPadded> value{};
  std::array<std::uint8_t, std::size_t{kBrickNodes} * kBrickNodes> known{};

  [[nodiscard]] static std::size_t first_of(std::size_t row) noexcept {
    return ((row / kBrickNodes + 1) * kPadded + row % kBrickNodes + 1) * kPadded + 1;
  }
  /// Visits the nodes that are not known, in order: the value that the seven nodes before predict if the
  /// distance is trilinear, and the node's own, which may be set.
  template <class Visit>
  void each_unknown(Visit&& visit) {
    constexpr unsigned kAll = (1u << kBrickNodes) - 1;
    constexpr std::size_t kX = kPadded * kPadded, kY = kPadded;
    for (std::size_t row = 0; row < known.size(); ++row) {
      if (known[row] == kAll) continue;
      std::uint16_t* const here = &value[first_of(row) - 1];
      std::array<std::uint16_t, kPadded> beside;
      for (std::size_t z = 0; z < kPadded; ++z)
        beside[z] = static_cast<std::uint16_t>(*(here + z - kX) + *(here + z - kY) - *(here + z - kX - kY));
      for (std::size_t z = 1; z < kPadded; ++z)
        if ((known[row] >> (z - 1) & 1) == 0)
          visit(static_cast<std::uint16_t>(here[z - 1] + beside[z] - beside[z - 1]), here[z]);
    }
  }
};

/// The nodes of a tile's bricks so far, in blocks of 4 x 4 x 4 that begin one voxel before a cube's corner.
class SharedNodes {
 public:
  SharedNodes() : slots_(kBlockSlots) {}
  void clear() {
    blocks_.clear();
    std::fill(slots_.begin(), slots_.end(), std::uint16_t{0});
  }
  void gather(const BrickPlace& brick, BrickNodes& nodes) {
    nodes.known.fill(0);
    each_row(brick,
             [&](const Block& block, std::size_t in_block, auto count, std::size_t row, std::size_t first) {
               const std::uint64_t bits = block.known >> in_block & ((1u << count) - 1);
               nodes.known[row] = static_cast<std::uint8_t>(nodes.known[row] | bits << first);
               std::memcpy(&nodes.value[BrickNodes::first_of(row) + first], &block.node[in_block],
                           count * sizeof(std::uint16_t));
             });
  }
  void keep(const BrickPlace& brick, const BrickNodes& nodes) {
    each_row(brick, [&](Block& block, std::size_t in_block, auto count, std::size_t row, std::size_t first) {
      block.known |= ((std::uint64_t{1} << count) - 1) << in_block;
      std::memcpy(&block.node[in_block], &nodes.value[BrickNodes::first_of(row) + first],
                  count * sizeof(std::uint16_t));
    });
  }

 private:
  struct Block {
    BrickPlace place;
    std::uint64_t known = 0;  ///< a bit a node
    std::array<std::uint16_t, kBlockEdge * kBlockEdge * kBlockEdge> node{};
  };
  Block& block_of(const BrickPlace& place) {
    auto hash = static_cast<std::uint64_t>(place.depth);
    for (const std::uint32_t x : place.cube) hash = (hash ^ x) * kGolden64;
    for (std::size_t i = hash >> (64 - kBlockBits);; i = (i + 1) & (kBlockSlots - 1)) {
      if (slots_[i] == 0) {
        blocks_.emplace_back().place = place;
        slots_[i] = static_cast<std::uint16_t>(blocks_.size());
        return blocks_.back();
      }
      Block& block = blocks_[slots_[i] - 1u];
      if (block.place == place) return block;
    }
  }
  /// Visits each row of a brick in two parts: block, first node in it, nodes (a constant), row, first node in
  /// the row.
  template <class Visit>
  void each_row(const BrickPlace& brick, Visit&& visit) {
    constexpr std::size_t kRest = kBrickNodes - kBlockEdge;
    for (std::uint32_t k = 0; k < 8; ++k) {
      const std::array<std::uint32_t, 3> on{k >> 2, k >> 1 & 1, k & 1};
      BrickPlace at = brick;
      for (std::size_t a = 0; a < 3; ++a) at.cube[a] += on[a];
      Block& block = block_of(at);
      for (std::size_t x = 0; x < (on[0] == 0 ? kBlockEdge : kRest); ++x)
        for (std::size_t y = 0; y < (on[1] == 0 ? kBlockEdge : kRest); ++y) {
          const std::size_t in_block = (x * kBlockEdge + y) * kBlockEdge;
          const std::size_t row = (kBlockEdge * on[0] + x) * kBrickNodes + kBlockEdge * on[1] + y;
          if (on[2] == 0)
            visit(block, in_block, std::integral_constant<std::size_t, kBlockEdge>(), row, std::size_t{0});
          else
            visit(block, in_block, std::integral_constant<std::size_t, kRest>(), row, kBlockEdge);
        }
    }
  }

  std::vector<Block> blocks_;
  std::vector<std::uint16_t> slots_;  ///< a hash table: a block's number, from 1
};

template <class Context, std::size_t (*kFree)(Context*)>
struct ZstdFree {
  void operator()(Context* context) const noexcept { static_cast<void>(kFree(context)); }
};

}  // namespace

class TileCoder::Work {
 public:
  Work() {
    if (packer_ == nullptr || unpacker_ == nullptr) throw std::bad_alloc();
  }
  Result<std::vector<std::byte>> pack(const BrickTile& tile, std::span<const Brick> bricks);
  /// What is wrong with the image; null: nothing.
  const char* unpack(std::span<const std::byte> image, int depth, int first_depth, std::size_t pieces,
                     UnpackedTile& out);

 private:
  void begin() {
    groups_ = 1;  // the root's
    places_.clear();
    shared_.clear();
    for (auto* part : {&tree_, &heads_, &high_, &low_}) part->clear();
  }
  bool decompress(std::span<const std::byte> packed, std::size_t most);
  void write_tree(const BrickTile& tile, std::size_t at, const BrickPlace& place);
  bool read_node(ByteReader& from, std::size_t at, const BrickPlace& place, bool brick, bool children,
                 UnpackedTile& out);
  bool read_bricks(ByteReader& from, std::size_t pieces, UnpackedTile& out);

  int first_depth_ = 0;  ///< of the largest bricks
  std::uint32_t groups_ = 0;
  std::vector<BrickPlace> places_;  ///< of the bricks
  SharedNodes shared_;
  std::vector<std::byte> tree_, heads_, high_, low_, payload_;
  std::unique_ptr<ZSTD_CCtx, ZstdFree<ZSTD_CCtx, &ZSTD_freeCCtx>> packer_{ZSTD_createCCtx()};
  std::unique_ptr<ZSTD_DCtx, ZstdFree<ZSTD_DCtx, &ZSTD_freeDCtx>> unpacker_{ZSTD_createDCtx()};
};

// --- packing

void TileCoder::Work::write_tree(const BrickTile& tile, std::size_t at, const BrickPlace& place) {
  const TileNode& node = tile.nodes[at];
  // Numbers follow from the order of the walk, in which the tile was cut.
  assert(node.brick == BrickGrid::kNone || node.brick == places_.size());
  assert(node.children == 0 || node.children == groups_);
  if (node.brick != BrickGrid::kNone) places_.push_back(place);
  if (node.children == 0) return;
  const std::size_t first = std::size_t{groups_++} * kGroupNodes;
  unsigned bricks = 0, children = 0;
  for (std::size_t k = 0; k < kGroupNodes; ++k) {
    bricks |= (tile.nodes[first + k].brick != BrickGrid::kNone ? 1u : 0u) << k;
    children |= (tile.nodes[first + k].children != 0 ? 1u : 0u) << k;
  }
  tree_.push_back(static_cast<std::byte>(bricks));
  tree_.push_back(static_cast<std::byte>(children));
  for (std::uint32_t k = 0; k < kGroupNodes; ++k) write_tree(tile, first + k, place.child(k));
}

Result<std::vector<std::byte>> TileCoder::Work::pack(const BrickTile& tile, std::span<const Brick> bricks) {
  begin();
  const TileNode& root = tile.nodes.front();
  tree_.push_back(static_cast<std::byte>((root.brick != BrickGrid::kNone ? kRootBrick : 0) |
                                         (root.children != 0 ? kRootChildren : 0)));
  write_tree(tile, 0, {});
  BrickNodes nodes;
  for (std::size_t b = 0; b < bricks.size(); ++b) {
    const Brick& brick = bricks[b];
    shared_.gather(places_[b], nodes);
    bool same = true;
    for (std::size_t row = 0, i = 0; row < nodes.known.size(); ++row)
      for (std::size_t z = 0; z < kBrickNodes; ++z, ++i) {
        std::uint16_t& value = nodes.value[BrickNodes::first_of(row) + z];
        const auto own = static_cast<std::uint16_t>(brick.distance[i]);
        same = same && ((nodes.known[row] >> z & 1) == 0 || value == own);
        value = own;
      }
    if (!same) nodes.known.fill(0);
    nodes.each_unknown([&](std::uint16_t predicted, std::uint16_t value) {
      const std::uint16_t number = folded(static_cast<std::uint16_t>(value - predicted));
      high_.push_back(static_cast<std::byte>(number >> 8));
      low_.push_back(static_cast<std::byte>(number & 0xff));
    });
    if (same) shared_.keep(places_[b], nodes);
    ByteWriter head = append_to(heads_, kBrickHeadBytes);
    head.u8(same ? 0 : kOwnNodes);
    head.u16(brick.piece);
    head.u64(brick.mask);
  }
  payload_.clear();
  for (const auto* part : {&tree_, &heads_, &high_, &low_})
    payload_.insert(payload_.end(), part->begin(), part->end());
  std::vector<std::byte> image(kTileHeadBytes + ZSTD_compressBound(payload_.size()));
  ByteWriter head{std::span(image)};
  head.u32(static_cast<std::uint32_t>(tile.nodes.size() / kGroupNodes));
  head.u32(static_cast<std::uint32_t>(tile.bricks.size()));
  const std::size_t packed =
      ZSTD_compressCCtx(packer_.get(), image.data() + kTileHeadBytes, image.size() - kTileHeadBytes,
                        payload_.data(), payload_.size(), kPackLevel);
  if (ZSTD_isError(packed) != 0)
    return Error{fmt::format("a tile cannot be packed: {}", ZSTD_getErrorName(packed)), "free some memory"};
  image.resize(kTileHeadBytes + packed);
  return image;
}

// --- unpacking

/// Groups are read as they are reached, so that none is twice and none leads back.
bool TileCoder::Work::read_node(ByteReader& from, std::size_t at, const BrickPlace& place, bool brick,
                                bool children, UnpackedTile& out) {
  if (brick) {
    if (place.depth < first_depth_ || places_.size() == out.bricks.size()) return false;
    out.nodes[at].brick = static_cast<std::uint32_t>(places_.size());
    places_.push_back(place);
  }
  if (!children) return true;
  // Below a largest brick's place only bricks lead on.
  if (place.depth >= search::kMortonBits || (place.depth >= first_depth_ && !brick) ||
      std::size_t{groups_} * kGroupNodes == out.nodes.size())
    return false;
  out.nodes[at].children = groups_;
  const std::size_t first = std::size_t{groups_++} * kGroupNodes;
  const unsigned bricks = from.u8(), lead_on = from.u8();
  for (std::uint32_t k = 0; k < kGroupNodes; ++k)
    if (!read_node(from, first + k, place.child(k), (bricks >> k & 1) != 0, (lead_on >> k & 1) != 0, out))
      return false;
  return from.good();
}

bool TileCoder::Work::read_bricks(ByteReader& from, std::size_t pieces, UnpackedTile& out) {
  ByteReader heads(from.raw(out.bricks.size() * kBrickHeadBytes));
  const std::size_t count = from.left() / 2;
  const std::span<const std::byte> high = from.raw(count), low = from.raw(count);
  if (!from.good() || from.left() != 0) return false;
  std::size_t next = 0;
  BrickNodes nodes;
  for (std::size_t b = 0; b < out.bricks.size(); ++b) {
    Brick& brick = out.bricks[b];
    const bool own = (heads.u8() & kOwnNodes) != 0;
    brick.piece = heads.u16();
    brick.mask = heads.u64();
    if (brick.piece > pieces) return false;
    shared_.gather(places_[b], nodes);
    if (own) nodes.known.fill(0);
    bool enough = true;
    nodes.each_unknown([&](std::uint16_t predicted, std::uint16_t& value) {
      enough = enough && next < count;
      if (!enough) return;
      const auto number = static_cast<std::uint16_t>(std::to_integer<unsigned>(high[next]) << 8 |
                                                     std::to_integer<unsigned>(low[next]));
      ++next;
      value = static_cast<std::uint16_t>(predicted + unfolded(number));
    });
    if (!enough) return false;
    if (!own) shared_.keep(places_[b], nodes);
    for (std::size_t row = 0, i = 0; row < nodes.known.size(); ++row)
      for (std::size_t z = 0; z < kBrickNodes; ++z, ++i)
        brick.distance[i] = static_cast<std::int16_t>(nodes.value[BrickNodes::first_of(row) + z]);
  }
  return next == count;
}

/// Of `most` bytes at most.
bool TileCoder::Work::decompress(std::span<const std::byte> packed, std::size_t most) {
#ifdef PALPATE_FUZZING
  // Fuzzing gets past the compression: its tiles have none.
  static_cast<void>(most);
  payload_.assign(packed.begin(), packed.end());
  return true;
#else
  const unsigned long long size = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (size > most) return false;  // so are its errors
  payload_.resize(static_cast<std::size_t>(size));
  return ZSTD_decompressDCtx(unpacker_.get(), payload_.data(), payload_.size(), packed.data(),
                             packed.size()) == payload_.size();
#endif
}

const char* TileCoder::Work::unpack(std::span<const std::byte> image, int depth, int first_depth,
                                    std::size_t pieces, UnpackedTile& out) {
  if (image.size() < kTileHeadBytes) return "it has no head";
  ByteReader head(image);
  const std::uint32_t groups = head.u32(), bricks = head.u32();
  if (bricks == 0 || bricks > kTileBricks || groups == 0 || groups > most_groups(bricks))
    return "its number of groups or bricks";
  if (!decompress(
          image.subspan(kTileHeadBytes),
          1 + 2 * std::size_t{groups} + bricks * (kBrickHeadBytes + 2 * std::size_t{kBrickCoefficients})))
    return "it cannot be unpacked";
  begin();
  first_depth_ = first_depth;
  out.nodes.assign(std::size_t{groups} * kGroupNodes, {});
  out.bricks.resize(bricks);
  ByteReader from{std::span<const std::byte>(payload_)};
  const unsigned root = from.u8();
  if (!read_node(from, 0, {depth, {}}, (root & kRootBrick) != 0, (root & kRootChildren) != 0, out) ||
      places_.size() != bricks || groups_ != groups)
    return "its tree leads astray";
  return read_bricks(from, pieces, out) ? nullptr : "its bricks";
}

// --- the face of it

TileCoder::TileCoder() : work_(std::make_unique<Work>()) {}
TileCoder::~TileCoder() = default;
TileCoder::TileCoder(TileCoder&&) noexcept = default;
TileCoder& TileCoder::operator=(TileCoder&&) noexcept = default;

Result<std::vector<std::byte>> TileCoder::pack(const BrickTile& tile, std::span<const Brick> bricks) {
  return work_->pack(tile, bricks);
}

Status TileCoder::unpack(std::span<const std::byte> image, TileKey key, const BrickGrid& grid,
                         UnpackedTile& out) {
  const char* wrong =
      work_->unpack(image, key.depth, depth_of_level(grid, 0), grid.closed_components.size(), out);
  if (wrong == nullptr) return Done{};
  return Error{fmt::format("tile {} of depth {} is damaged: {}", key.code, key.depth, wrong),
               "prepare the scan again"};
}

}  // namespace palpate::spline_sdf
