#include "toolkit/spline_sdf/surface_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>

#include "toolkit/core/bytes.h"

namespace palpate::spline_sdf {
namespace {

using namespace surface_layout;

constexpr const char* kPrepareAgain = "prepare the scan again: palpate prepare SCAN --out FILE";

/// Fuzzing gets past checksums.
bool is_right(std::uint64_t checksum, std::uint64_t stored) noexcept {
#ifdef PALPATE_FUZZING
  static_cast<void>(checksum);
  static_cast<void>(stored);
  return true;
#else
  return checksum == stored;
#endif
}

bool get_geometry(ByteReader& from, StoredSurface& out) {
  SplineSdf& surface = out.surface;
  BrickGrid& grid = surface.grid;
  const std::size_t start = from.at();
  grid.low_mm = from.vec();
  grid.box_mm.low_mm = from.vec();
  grid.box_mm.high_mm = from.vec();
  grid.voxel_mm = from.real();
  grid.min_enclosed = from.real();
  surface.spacing_mm = from.real();
  surface.noise_mm = from.real();
  out.rms_mm = from.real();
  grid.coarser = from.i32();
  grid.levels = from.i32();
  grid.last_brick = from.i64();
  surface.cubes = from.u64();
  surface.patches = static_cast<std::size_t>(from.u64());
  surface.isolated_points = static_cast<std::size_t>(from.u64());
  static_cast<void>(from.raw(kGeometryBytes - (from.at() - start)));
  grid.per_voxel = 1.0 / grid.voxel_mm;
  if (grid.coarser < 0 || grid.coarser > BrickGrid::kMaxCoarser || grid.levels < 1 ||
      grid.levels > grid.coarser + BrickGrid::kFineLevels)
    return false;
  const std::int64_t most = (std::int64_t{1} << (search::kMortonBits - grid.levels + 1)) - 1;
  return from.good() && is_finite(grid.low_mm) && is_finite(grid.box_mm.low_mm) &&
         is_finite(grid.box_mm.high_mm) && grid.voxel_mm > 0.0 && std::isfinite(grid.voxel_mm) &&
         std::isfinite(grid.per_voxel) && surface.spacing_mm >= 0.0 && std::isfinite(surface.spacing_mm) &&
         grid.levels >= 1 && grid.levels <= grid.coarser + BrickGrid::kFineLevels && grid.last_brick >= 0 &&
         grid.last_brick <= most;
}

bool get_pieces(ByteReader& from, BrickGrid& grid) {
  const std::uint32_t pieces = from.u32();
  if (pieces > 0xffffu) return false;  // Brick::piece has sixteen bits
  for (std::uint32_t p = 0; p < pieces && from.good(); ++p) {
    ClosedComponent piece;
    piece.normal_orientation = from.single();
    piece.tight = from.u8() != 0;
    const std::uint32_t parts = from.u32();
    if (from.left() / kPartBytes < parts) return false;
    std::vector<geometry::AreaElement> elements(parts);
    for (geometry::AreaElement& part : elements) {
      for (int a = 0; a < 3; ++a) part.middle[a] = from.single();
      for (int a = 0; a < 3; ++a) part.area[a] = from.single();
    }
    piece.parts = geometry::SurfaceParts(std::move(elements));
    grid.closed_components.push_back(std::move(piece));
  }
  return from.good();
}

/// A brick's number at its place.
struct NumberedBrick {
  TileKey key;
  std::uint32_t brick = 0;
  bool refined = false;  ///< smaller ones replace it
};

/// Makes the levels' tables of a grid. Those of a level stand by code.
void build_tables(std::span<const NumberedBrick> bricks, BrickGrid& grid) {
  for (int l = 0; l < grid.levels; ++l) {
    std::vector<std::uint64_t> codes;
    BrickGrid::Level& level = grid.level[static_cast<std::size_t>(l)];
    level = {};
    for (const NumberedBrick& one : bricks) {
      if (one.key.depth != depth_of_level(grid, l)) continue;
      codes.push_back(one.key.code);
      level.brick.push_back(one.brick | (one.refined ? BrickGrid::kRefined : 0u));
    }
    level.table.build(codes);
  }
}

Error damaged(const std::string& path, std::string_view what) {
  return {fmt::format("the prepared file is damaged: {}", what), kPrepareAgain, path};
}

/// The index's part on one surface, whose tiles begin at `tiles_at`; false where it makes no sense.
bool get_surface(ByteReader& from, std::uint64_t& tiles_at, std::uint64_t tiles_end, StoredSurface& out) {
  BrickGrid& grid = out.surface.grid;
  if (!get_geometry(from, out) || !get_pieces(from, grid)) return false;
  const std::uint32_t tiles = from.u32();
  if (from.left() / kTileRowBytes < tiles) return false;
  out.keys.reserve(tiles);
  out.places.reserve(tiles);
  std::uint64_t next = 0;
  for (std::uint32_t i = 0; i < tiles; ++i) {
    const TileKey key{from.u64(), from.i32()};
    StoredSurface::Place place;
    place.size.groups = from.u32();
    place.offset = from.u64();
    place.checksum = from.u64();
    place.bytes = from.u32();
    place.size.bricks = from.u32();
    if (place.size.bricks == 0 || place.size.bricks > kTileBricks || place.size.groups == 0 ||
        place.size.groups > most_groups(place.size.bricks))
      return false;
    if (key.depth < 0 || key.depth > search::kMortonBits || key.code >> (3 * key.depth) != 0) return false;
    if (i > 0 && key.first_code() < next) return false;  // tiles overlap
    next = TileKey{key.code + 1, key.depth}.first_code();
    // Tiles stand back to back, so that none is counted twice.
    if (place.offset != tiles_at || place.bytes > tiles_end - tiles_at) return false;
    tiles_at += place.bytes;
    out.keys.push_back(key);
    out.places.push_back(place);
    out.tile_bytes += place.bytes;
  }
  const std::uint32_t above = from.u32();
  if (from.left() / (12 + kStoredBrickBytes) < above) return false;
  std::vector<NumberedBrick> bricks(above);
  grid.bricks.resize(above);
  std::map<int, std::uint64_t> next_of;  // by depth: codes ascend, as the tables want them
  for (std::uint32_t i = 0; i < above; ++i) {
    const TileKey key{from.u64(), from.i32()};
    std::uint64_t& least = next_of[key.depth];
    if (key.depth < depth_of_level(grid, 0) || key.depth > search::kMortonBits || key.code < least ||
        key.code >> (3 * key.depth) != 0)
      return false;
    least = key.code + 1;
    read_stored_brick(from.raw(kStoredBrickBytes), grid.bricks[i]);
    if (grid.bricks[i].piece > grid.closed_components.size()) return false;
    bricks[i] = {key, i, true};
  }
  build_tables(bricks, grid);
  return from.good();
}

/// A tile's bricks with their keys, by walking its nodes.
void collect_bricks(std::span<const TileNode> nodes, std::size_t at, TileKey key,
                    std::vector<NumberedBrick>& into) {
  const TileNode& node = nodes[at];
  if (node.brick != BrickGrid::kNone) into.push_back({key, node.brick, node.children != 0});
  if (node.children == 0) return;
  for (std::uint64_t k = 0; k < kGroupNodes; ++k)
    collect_bricks(nodes, std::size_t{node.children} * kGroupNodes + k, {key.code << 3 | k, key.depth + 1},
                   into);
}

}  // namespace

bool SurfaceFile::begins_as_one(std::span<const std::byte> first_bytes) noexcept {
  return first_bytes.size() >= kMagic.size() &&
         std::memcmp(first_bytes.data(), kMagic.data(), kMagic.size()) == 0;
}

Result<std::shared_ptr<const SurfaceFile>> SurfaceFile::open(const std::string& path) {
  PALPATE_ASSIGN(InputFile input, InputFile::open(path));
  std::shared_ptr<SurfaceFile> file(new SurfaceFile(std::move(input)));
  PALPATE_TRY(file->read_index());
  return std::shared_ptr<const SurfaceFile>(std::move(file));
}

Status SurfaceFile::read_index() {
  const std::uint64_t size = file_.size();
  if (size < kFileHeadBytes + kFileEndBytes) return damaged(path(), "it is too short");
  std::array<std::byte, kFileHeadBytes> head{};
  PALPATE_TRY(file_.read_at(0, head));
  if (!begins_as_one(head)) return Error{"this is no prepared file", kPrepareAgain, path()};
  ByteReader version(std::span<const std::byte>(head).subspan(kMagic.size()));
  if (const std::uint32_t is = version.u32(); is != kVersion)
    return Error{fmt::format("the prepared file has version {}, this Palpate reads {}", is, kVersion),
                 kPrepareAgain, path()};
  std::array<std::byte, kFileEndBytes> end{};
  PALPATE_TRY(file_.read_at(size - kFileEndBytes, end));
  ByteReader tail{std::span<const std::byte>(end)};
  const std::uint64_t offset = tail.u64(), bytes = tail.u64();
  content_hash_ = tail.u64();
  if (!begins_as_one(std::span<const std::byte>(end).subspan(24)) || bytes > kMaxIndexBytes ||
      offset < kFileHeadBytes || offset > size || bytes != size - kFileEndBytes - offset)
    return damaged(path(), "its end is not where its index says");
  std::vector<std::byte> index(static_cast<std::size_t>(bytes));
  PALPATE_TRY(file_.read_at(offset, index));
  if (!is_right(checksum_of(index), content_hash_)) return damaged(path(), "the checksum of its index");
  ByteReader from{std::span<const std::byte>(index)};
  points_ = from.u64();
  auto sample = std::make_shared<cloud::Cloud>();
  sample->origin_mm = from.vec();
  const std::uint32_t count = from.u32();
  if (!is_finite(sample->origin_mm) || count == 0 || from.left() / 12 < count)
    return damaged(path(), "its sample of points");
  for (std::uint32_t i = 0; i < count; ++i) {
    sample->x_mm.push_back(from.single());
    sample->y_mm.push_back(from.single());
    sample->z_mm.push_back(from.single());
    if (!is_finite(sample->local_mm(i))) return damaged(path(), "its sample of points");
  }
  sample_ = std::move(sample);
  // Each surface takes some bytes, so that a large number ends soon.
  const std::uint32_t surfaces = from.u32();
  std::uint64_t tiles_at = kFileHeadBytes;
  for (std::uint32_t i = 0; i < surfaces; ++i) {
    surfaces_.emplace_back();
    if (!get_surface(from, tiles_at, offset, surfaces_.back()))
      return damaged(path(), fmt::format("its index, surface {}", i));
  }
  if (surfaces_.empty() || from.left() != 0 || tiles_at != offset)
    return damaged(path(), "its index has another length");
  return Done{};
}

Status SurfaceFile::read_tile(std::size_t surface, std::size_t tile, TileBuffer& buffer) const {
  const StoredSurface& of = surfaces_[surface];
  const StoredSurface::Place& place = of.places[tile];
  buffer.image.resize(place.bytes);
  PALPATE_TRY(file_.read_at(place.offset, buffer.image));
  if (!is_right(checksum_of(buffer.image), place.checksum))
    return damaged(path(), fmt::format("tile {} of surface {} has another checksum", tile, surface));
  const Status whole = buffer.coder.unpack(buffer.image, of.keys[tile], of.surface.grid, buffer.tile);
  if (!whole) return damaged(path(), whole.error().what);
  if (buffer.tile.size() != place.size)
    return damaged(path(), fmt::format("tile {} of surface {} has another size", tile, surface));
  return Done{};
}

Result<std::shared_ptr<const SplineSdf>> SurfaceFile::load(std::size_t surface) const {
  const StoredSurface& of = surfaces_[surface];
  auto out = std::make_shared<SplineSdf>(of.surface);
  BrickGrid& grid = out->grid;
  std::vector<NumberedBrick> bricks;
  for (int l = 0; l < grid.levels; ++l) {
    const BrickGrid::Level& level = of.surface.grid.level[static_cast<std::size_t>(l)];
    const std::vector<std::uint64_t> codes = level.table.codes(level.brick.size());
    for (std::size_t cell = 0; cell < codes.size(); ++cell)
      bricks.push_back(
          {{codes[cell], depth_of_level(grid, l)}, level.brick[cell] & ~BrickGrid::kRefined, true});
  }
  TileBuffer buffer;
  for (std::size_t tile = 0; tile < of.keys.size(); ++tile) {
    PALPATE_TRY(read_tile(surface, tile, buffer));
    const std::size_t first = bricks.size();
    collect_bricks(buffer.tile.nodes, 0, of.keys[tile], bricks);
    for (NumberedBrick& one : std::span(bricks).subspan(first))
      one.brick += static_cast<std::uint32_t>(grid.bricks.size());
    grid.bricks.insert(grid.bricks.end(), buffer.tile.bricks.begin(), buffer.tile.bricks.end());
  }
  std::sort(bricks.begin(), bricks.end(), [](const NumberedBrick& a, const NumberedBrick& b) {
    return std::pair(a.key.depth, a.key.code) < std::pair(b.key.depth, b.key.code);
  });
  build_tables(bricks, grid);
  return std::shared_ptr<const SplineSdf>(std::move(out));
}

}  // namespace palpate::spline_sdf
