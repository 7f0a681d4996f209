#include "toolkit/spline_sdf/surface_writer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "toolkit/core/bytes.h"
#include "toolkit/core/parallel.h"
#include "toolkit/spline_sdf/spline.h"
#include "toolkit/spline_sdf/surface_file.h"

namespace palpate::spline_sdf {
namespace {

using namespace surface_layout;

/// Steps a voxel in which distances are summed. A square of the largest distance is 2^44, and samples
/// are below 2^18: sums fit.
constexpr double kDistanceSteps = 0x1p19;
static_assert(kMaxBrickDistance * kDistanceSteps <= 0x1p22);
/// Tiles packed at once, some 12 MB, and by one thread in a go.
constexpr std::size_t kTilesAtOnce = 64, kTileGrain = 8;

void put_geometry(const SplineSdf& surface, double rms_mm, IndexBytes& index) {
  const BrickGrid& grid = surface.grid;
  index.put(kGeometryBytes, [&](ByteWriter& to) {
    to.vec(grid.low_mm);
    to.vec(grid.box_mm.low_mm);
    to.vec(grid.box_mm.high_mm);
    to.real(grid.voxel_mm);
    to.real(grid.min_enclosed);
    to.real(surface.spacing_mm);
    to.real(surface.noise_mm);
    to.real(rms_mm);
    to.i32(grid.coarser);
    to.i32(grid.levels);
    to.i64(grid.last_brick);
    to.u64(surface.cubes);
    to.u64(surface.patches);
    to.u64(surface.isolated_points);
    while (to.size() < kGeometryBytes) to.u64(0);
  });
}

/// The pieces, with their parts joined: a twentieth of the bytes.
void put_pieces(const BrickGrid& grid, IndexBytes& index) {
  index.put(4, [&](ByteWriter& to) { to.u32(static_cast<std::uint32_t>(grid.closed_components.size())); });
  for (const ClosedComponent& piece : grid.closed_components) {
    const std::vector<geometry::AreaElement> parts =
        joined_in_cubes(piece.parts.elements(), std::ldexp(grid.cube_edge(), kJoinedBits));
    index.put(9 + parts.size() * kPartBytes, [&](ByteWriter& to) {
      to.single(piece.normal_orientation);
      to.u8(piece.tight ? 1 : 0);
      to.u32(static_cast<std::uint32_t>(parts.size()));
      for (const geometry::AreaElement& part : parts) {
        for (int a = 0; a < 3; ++a) to.single(part.middle[a]);
        for (int a = 0; a < 3; ++a) to.single(part.area[a]);
      }
    });
  }
}

}  // namespace

double SampleDistances::rms_voxels() const noexcept {
  return count == 0 ? 0.0
                    : std::sqrt(static_cast<double>(squares) / static_cast<double>(count)) / kDistanceSteps;
}

void add_distances(const BrickGrid& grid, const cloud::Cloud& points, const BrickRegion* region,
                   SampleDistances& into) {
  const double per_edge = 1.0 / grid.cube_edge();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 at = grid.in_voxels(points.local_mm(i));
    const Vec3 cube = (at * per_edge).array().floor();
    if (region != nullptr &&
        !region->contains({static_cast<std::int32_t>(cube.x()), static_cast<std::int32_t>(cube.y()),
                           static_cast<std::int32_t>(cube.z())}))
      continue;
    const BrickGrid::BrickRef place = grid.find(at);
    if (place.brick == BrickGrid::kNone) continue;
    const double per = grid.per_voxel_of(place.level);
    BrickPosition in;
    for (std::size_t a = 0; a < 3; ++a) {
      const double cells =
          at[static_cast<Eigen::Index>(a)] * per - kBrickCells * static_cast<double>(place.cube[a]);
      in.cell[a] = std::clamp(static_cast<int>(std::floor(cells)), 0, kBrickCells - 1);
      in.t[a] = static_cast<float>(cells - in.cell[a]);
    }
    const double voxels = static_cast<double>(spline_value(grid.bricks[place.brick], in)) / per;
    const auto steps = static_cast<std::int64_t>(std::llround(voxels * kDistanceSteps));
    into.squares += static_cast<std::uint64_t>(steps * steps);
    ++into.count;
  }
}

Result<SurfaceFileWriter> SurfaceFileWriter::create(const std::string& path, std::uint64_t points,
                                                    std::shared_ptr<const cloud::Cloud> sample) {
  PALPATE_ASSIGN(AtomicFile file, AtomicFile::create(path));
  SurfaceFileWriter out(std::move(file), points, std::move(sample));
  std::array<std::byte, kFileHeadBytes> head{};
  ByteWriter to{std::span<std::byte>(head)};
  to.raw(std::as_bytes(std::span(kMagic)));
  to.u32(kVersion);
  to.u32(0);
  PALPATE_TRY(out.file_.write(head));
  out.at_ = kFileHeadBytes;
  return out;
}

Status SurfaceFileWriter::add(const SplineSdf& surface, int threads) {
  SampleDistances distances;
  add_distances(surface.grid, *sample_, nullptr, distances);
  return add(
      surface, [&](const TileSink& sink) { return cut_into_tiles(surface.grid, sink); },
      bricks_of(surface.grid), distances, threads);
}

Status SurfaceFileWriter::add(const SplineSdf& surface, const CutBricks& cut, const BrickSource& bricks,
                              const SampleDistances& distances, int threads) {
  ++surfaces_;
  put_geometry(surface, distances.rms_voxels() * surface.grid.voxel_mm, index_);
  put_pieces(surface.grid, index_);
  IndexBytes rows, above;
  std::uint32_t tiles = 0, bricks_above = 0;
  struct Unpacked {
    BrickTile tile;
    std::vector<Brick> bricks;
  };
  std::vector<Unpacked> next;
  std::vector<Result<std::vector<std::byte>>> images;
  const auto write_tiles = [&]() -> Status {
    images.assign(next.size(), Error{});
    parallel_chunks(next.size(), kTileGrain, threads, [&](std::size_t begin, std::size_t end) {
      TileCoder coder;
      for (std::size_t i = begin; i < end; ++i) images[i] = coder.pack(next[i].tile, next[i].bricks);
    });
    for (std::size_t i = 0; i < next.size(); ++i) {
      PALPATE_ASSIGN(const std::vector<std::byte> image, std::move(images[i]));
      PALPATE_TRY(file_.write(image));
      rows.put(kTileRowBytes, [&](ByteWriter& to) {
        to.u64(next[i].tile.key.code);
        to.i32(next[i].tile.key.depth);
        to.u32(static_cast<std::uint32_t>(next[i].tile.nodes.size() / kGroupNodes));
        to.u64(at_);
        to.u64(checksum_of(image));
        to.u32(static_cast<std::uint32_t>(image.size()));
        to.u32(static_cast<std::uint32_t>(next[i].tile.bricks.size()));
      });
      at_ += image.size();
      ++tiles;
    }
    next.clear();
    return Done{};
  };
  const auto put_tile = [&](const BrickTile& tile) -> Status {
    next.push_back({tile, std::vector<Brick>(tile.bricks.size())});
    for (std::size_t b = 0; b < tile.bricks.size(); ++b)
      PALPATE_TRY(bricks(tile.bricks[b], next.back().bricks[b]));
    return next.size() < kTilesAtOnce ? Status(Done{}) : write_tiles();
  };
  const auto put_above = [&](const PlacedBrick& one) -> Status {
    Brick brick;
    PALPATE_TRY(bricks(one.brick, brick));
    above.put(12 + kStoredBrickBytes, [&](ByteWriter& to) {
      to.u64(one.key.code);
      to.i32(one.key.depth);
      write_stored_brick(brick, to);
    });
    ++bricks_above;
    return Done{};
  };
  PALPATE_TRY(cut({put_tile, put_above}));
  PALPATE_TRY(write_tiles());
  index_.put(4 + rows.bytes().size(), [&](ByteWriter& to) {
    to.u32(tiles);
    to.raw(rows.bytes());
  });
  index_.put(4 + above.bytes().size(), [&](ByteWriter& to) {
    to.u32(bricks_above);
    to.raw(above.bytes());
  });
  return Done{};
}

Status SurfaceFileWriter::finish() {
  const cloud::Cloud& sample = *sample_;
  IndexBytes index;
  index.put(40 + sample.size() * 12 + index_.bytes().size(), [&](ByteWriter& out) {
    out.u64(points_);
    out.vec(sample.origin_mm);
    out.u32(static_cast<std::uint32_t>(sample.size()));
    for (std::size_t i = 0; i < sample.size(); ++i) {
      out.single(sample.x_mm[i]);
      out.single(sample.y_mm[i]);
      out.single(sample.z_mm[i]);
    }
    out.u32(surfaces_);
    out.raw(index_.bytes());
  });
  PALPATE_TRY(file_.write(index.bytes()));
  std::array<std::byte, kFileEndBytes> end{};
  ByteWriter last{std::span<std::byte>(end)};
  last.u64(at_);
  last.u64(index.bytes().size());
  last.u64(checksum_of(index.bytes()));
  last.raw(std::as_bytes(std::span(kMagic)));
  PALPATE_TRY(file_.write(end));
  return file_.commit();
}

}  // namespace palpate::spline_sdf
