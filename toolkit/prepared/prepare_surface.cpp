#include "toolkit/prepared/prepare.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"

#include "toolkit/prepared/chunk_scratch.h"
#include "toolkit/spline_sdf/point_noise.h"
#include "toolkit/spline_sdf/prepared_surface.h"
#include "toolkit/spline_sdf/surface_chunk.h"

namespace palpate::prepared {
namespace {

using spline_sdf::BrickGrid;
using spline_sdf::BrickRegion;
using spline_sdf::MortonPoints;

/// The program itself and buffers.
constexpr std::uint64_t kFixedSurfaceBytes = std::uint64_t{96} << 20;
/// Kept of each point to the end: rims and seams of regions, of 48 bytes for a brick of some 25 points, a
/// thirtieth of all; the table of cells; rows of tiles. Twice their sum, since regions may be smaller.
constexpr double kKeptBytesPerPoint = 0.25;
/// While regions are made: a point of the coarser surface; a point for rays.
constexpr std::uint64_t kCoarseBytes = 12, kFarBytes = 50;
/// When they are joined: a part of a piece has a brick, of some 25 points, and once more while they grow.
constexpr std::uint64_t kPartBytes = 2 * sizeof(geometry::AreaElement), kJoinBytesPerPoint = 2;
/// Runs of adjacent cells that tell spacing and noise, and cells of a run: a run's rim is a fiftieth of it.
constexpr std::size_t kProbeRuns = 16, kCellsOfRun = 16;
/// The first cells of a run, a quarter, are made into a surface to see what that takes.
constexpr std::size_t kBuiltOfRun = 4;
/// Most bytes at once of a region's points and patches, and of its bricks with what makes them: fitted to
/// terrain (85 bytes a point, a brick for 25), merged range scans (430 and 690; .43 bricks) and a scan of
/// trees (1,350; 1.5 bricks), and a tenth more.
constexpr double kBytesWithoutBricks = 64.0, kBytesPerBrick = 1600.0;
/// Largest rounding of a coordinate, in spacings: what a clean fit calls exact is five times as much.
constexpr double kMostRounding = 0.01;
/// Points for rays: a 64th of all, of eight times the spacing.
constexpr std::uint64_t kFarShare = 64;
/// Every file has it in its key: chunks of another kind are not gone on with.
constexpr std::uint64_t kChunkVersion = 4;

/// Chunks of the surface of every `step`th point.
std::string chunk_path(const std::string& path, std::uint64_t step) {
  return path + (step == 1 ? std::string(".chunks") : fmt::format(".chunks-{}", step));
}

/// The surface of every `step`th point, region by region.
class SurfacePreparation {
 public:
  SurfacePreparation(const CellFile& cells, const PrepareSurfaceOptions& options, const std::string& path,
                     std::uint64_t step, Progress& progress)
      : cells_(cells), options_(options), path_(path), step_(step), progress_(progress) {
    const geometry::Aabb& box = cells.info().bounds_mm;
    origin_mm_ = 0.5 * (box.low_mm + box.high_mm);
    std::uint64_t first = 0;
    for (std::size_t cell = 0; cell < cells.size(); first += cells.entry(cell++).points)
      firsts_.push_back(first);
  }

  /// Adds it to the writer, which it makes where there is none. `is_last`: the coarser ones too, since they
  /// fit in memory.
  Status add_to(std::optional<spline_sdf::SurfaceFileWriter>& writer, bool& is_last) {
    PALPATE_TRY(decide(writer ? writer->sample() : nullptr));
    PALPATE_TRY(choose_regions());
    PALPATE_ASSIGN(ChunkScratch scratch,
                   ChunkScratch::open(chunk_path(path_, step_), key(), frame_.lattice()));
    report_.resumed = scratch.chunks().size();
    for (std::size_t r = scratch.chunks().size(); r < regions_.size(); ++r) {
      if (progress_.cancelled()) return Error{"preparing was stopped", "run it again to go on"};
      progress_.report("making the surface", static_cast<double>(r) / static_cast<double>(regions_.size()));
      PALPATE_ASSIGN(cloud::Cloud points, points_in(region_mm(regions_[r]).grown(frame_.margin_mm())));
      PALPATE_TRY(scratch.add(
          spline_sdf::build_surface_chunk(std::move(points), regions_[r], frame_, options_.threads)));
    }
    if (scratch.bricks() == 0) {
      scratch.remove();
      return spline_sdf::no_surface();
    }
    if (!writer) {
      PALPATE_ASSIGN(writer,
                     spline_sdf::SurfaceFileWriter::create(path_, cells_.info().points, frame_.sample));
    }
    frame_.far.reset();
    PALPATE_TRY(write_joined(scratch, *writer));
    report_.chunks = regions_.size();
    is_last = coarse_step_ == step_ * spline_sdf::kCoarserShare;
    if (!is_last) return Done{};
    const render::PrepareContext context{options_.threads, &progress_};
    return spline_sdf::add_coarser_surfaces(*coarse_, MortonPoints(*coarse_, options_.threads),
                                            coarse_->size(), options_.build, context, *writer);
  }
  [[nodiscard]] const PrepareSurfaceReport& report() const noexcept { return report_; }

 private:
  /// Of all that chunks depend on: cells made again from the same scan are the same.
  [[nodiscard]] std::uint64_t key() const {
    Hash64 hash;
    hash.u64(kChunkVersion);
    hash.real(options_.build.detail);
    hash.real(options_.build.voxel_spacings);
    hash.real(cells_.info().lattice.unit_mm());
    for (int axis = 0; axis < 3; ++axis) hash.real(origin_mm_[axis]);
    for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
      const CellEntry& entry = cells_.entry(cell);
      for (const std::uint64_t base : entry.base) hash.u64(base);
      hash.u64(entry.shift);
      hash.u64(entry.hash);
    }
    for (const BrickRegion& region : regions_) hash.u64(spline_sdf::morton_code_of(region.low));
    hash.u64(coarse_->size());
    hash.u64(step_);
    return hash.value();
  }
  [[nodiscard]] std::uint64_t points() const noexcept { return cells_.info().points / step_; }
  /// Memory beside what is kept.
  [[nodiscard]] std::uint64_t work_bytes() const noexcept {
    const std::uint64_t fixed =
        kFixedSurfaceBytes +
        static_cast<std::uint64_t>(static_cast<double>(cells_.info().points) * kKeptBytesPerPoint);
    return options_.memory_bytes > fixed ? options_.memory_bytes - fixed : 0;
  }
  /// Points whose surface can be made in so much memory.
  [[nodiscard]] std::uint64_t fitting(std::uint64_t bytes) const noexcept {
    return std::min(options_.most_chunk_points,
                    static_cast<std::uint64_t>(static_cast<double>(bytes) / bytes_per_point_));
  }
  /// Memory for a region and what is around it.
  [[nodiscard]] double region_bytes() const noexcept {
    const std::uint64_t kept = coarse_->size() * kCoarseBytes + frame_.far->size() * kFarBytes;
    return static_cast<double>(work_bytes() > kept ? work_bytes() - kept : 0);
  }
  [[nodiscard]] geometry::Aabb region_mm(const BrickRegion& region) const {
    return region.cubes_mm(frame_.lattice());
  }
  [[nodiscard]] geometry::Aabb cell_box_mm(std::size_t cell) const {
    const geometry::Aabb box = cells_.box_mm(cell);
    return {box.low_mm - origin_mm_, box.high_mm - origin_mm_};
  }

  /// Adds every `step`th of all points, those in the cell that `wanted(place)` takes.
  template <class Wanted>
  Status add_points(std::size_t cell, std::uint64_t step, cloud::Cloud& into, Wanted&& wanted) {
    PALPATE_TRY(cells_.read_cell(cell, bytes_, read_));
    for (std::size_t i = 0; i < read_.own; ++i) {
      if ((firsts_[cell] + i) % step != step / 2) continue;
      const Vec3 at = read_.points_mm[i] - origin_mm_;
      if (!wanted(at)) continue;
      into.x_mm.push_back(static_cast<float>(at.x()));
      into.y_mm.push_back(static_cast<float>(at.y()));
      into.z_mm.push_back(static_cast<float>(at.z()));
    }
    return Done{};
  }
  [[nodiscard]] cloud::Cloud empty_cloud() const {
    cloud::Cloud out;
    out.origin_mm = origin_mm_;
    return out;
  }
  Result<cloud::Cloud> points_in(const geometry::Aabb& box) {
    cloud::Cloud out = empty_cloud();
    for (std::size_t cell = 0; cell < cells_.size(); ++cell)
      if (cell_box_mm(cell).overlaps(box))
        PALPATE_TRY(add_points(cell, step_, out, [&](const Vec3& at) { return box.contains(at); }));
    return out;
  }

  /// Bricks a point differ from scan to scan, and in one, by a factor of forty. `parts`: by run.
  void count_bricks(std::vector<cloud::Cloud> parts) {
    const BrickGrid lattice = frame_.lattice();
    for (cloud::Cloud& part : parts) {
      bytes_of_run_.push_back(kSurfaceBytesPerPoint);
      if (part.empty()) continue;
      geometry::Aabb box;
      for (std::size_t i = 0; i < part.size(); ++i) box.add(part.local_mm(i));
      const auto cube_of = [&](const Vec3& at_mm) {
        const Vec3 cube = (lattice.in_voxels(at_mm) / lattice.cube_edge()).array().floor();
        return BrickGrid::Coordinate{static_cast<std::int32_t>(cube.x()), static_cast<std::int32_t>(cube.y()),
                                     static_cast<std::int32_t>(cube.z())};
      };
      BrickRegion region{frame_.points.box_mm, frame_.coarser, cube_of(box.low_mm), cube_of(box.high_mm)};
      region = region.grown(1);
      const auto points = static_cast<double>(part.size());
      const auto made = spline_sdf::build_surface_chunk(std::move(part), region, frame_, options_.threads);
      bytes_of_run_.back() =
          kBytesWithoutBricks + kBytesPerBrick * static_cast<double>(made.own.size()) / points;
    }
    bytes_per_point_ = std::accumulate(bytes_of_run_.begin(), bytes_of_run_.end(), 0.0) /
                       static_cast<double>(bytes_of_run_.size());
  }
  /// Takes every coarse_step_th point: so many that their surface fits.
  Status sample_coarse() {
    while (coarse_step_ == step_ || cells_.info().points / coarse_step_ > fitting(work_bytes()))
      coarse_step_ *= spline_sdf::kCoarserShare;
    auto coarse = std::make_shared<cloud::Cloud>(empty_cloud());
    for (auto* axis : {&coarse->x_mm, &coarse->y_mm, &coarse->z_mm})
      axis->reserve(static_cast<std::size_t>(cells_.info().points / coarse_step_ + 1));
    for (std::size_t cell = 0; cell < cells_.size(); ++cell)
      PALPATE_TRY(add_points(cell, coarse_step_, *coarse, [](const Vec3&) { return true; }));
    coarse_ = std::move(coarse);
    return Done{};
  }

  /// Measures what all regions share, and samples the points. `sample`: the file's; null: not there yet.
  Status decide(std::shared_ptr<const cloud::Cloud> sample) {
    const auto all = [](const Vec3&) { return true; };
    const CellFileInfo& info = cells_.info();
    if (std::min(points() * kJoinBytesPerPoint, spline_sdf::kMostParts * kPartBytes) > work_bytes())
      return over_memory_limit(fmt::format("joining the surface of {} points", format_count(points())),
                               options_.memory_bytes);
    cloud::Cloud probe = empty_cloud();
    std::vector<cloud::Cloud> parts;
    const std::size_t wide = kCellsOfRun * step_;
    run_ = std::max(cells_.size() / kProbeRuns, wide);
    for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
      const std::size_t at = cell % run_;
      if (at < wide) PALPATE_TRY(add_points(cell, step_, probe, all));
      if (at == 0) parts.push_back(empty_cloud());
      if (at < wide / kBuiltOfRun) PALPATE_TRY(add_points(cell, step_, parts.back(), all));
    }
    const MortonPoints probed(probe, options_.threads);
    spline_sdf::SplineSdfDecision& measured = frame_.measured;
    measured.spacing_mm = probed.spacing_mm();
    if (!(measured.spacing_mm > 0.0)) return spline_sdf::no_surface();
    measured.noise_mm = spline_sdf::estimate_noise(probed, options_.threads);
    measured.voxel_mm = options_.build.voxel_spacings * measured.spacing_mm;
    spline_sdf::PointPatches any;
    any.patch[0] = 0;
    frame_.coarser =
        spline_sdf::coarser_levels(probed, std::vector<spline_sdf::PointPatches>(probed.size(), any));
    frame_.build = options_.build;
    frame_.points.box_mm =
        geometry::Aabb{info.bounds_mm.low_mm - origin_mm_, info.bounds_mm.high_mm - origin_mm_}.grown(
            info.quantum_mm);
    frame_.points.spacing_mm = measured.spacing_mm;
    const double farthest = frame_.points.box_mm.high_mm.maxCoeff();
    if (farthest * kUnitRoundoffFloat > kMostRounding * measured.spacing_mm)
      return Error{fmt::format("points over {} mm, {} mm apart, are too many for one surface",
                               format_number(2.0 * farthest), format_number(measured.spacing_mm)),
                   "prepare the scan in parts, or remove points far away", cells_.path()};
    report_.spacing_mm = measured.spacing_mm;
    report_.noise_mm = measured.noise_mm;
    coarse_step_ = step_;
    PALPATE_TRY(sample_coarse());
    const MortonPoints sorted(*coarse_, options_.threads);
    frame_.sample = sample != nullptr ? std::move(sample)
                                      : spline_sdf::thinned(sorted, *coarse_, spline_sdf::kSamplePoints);
    frame_.far = std::make_shared<const MortonPoints>(
        *spline_sdf::thinned(sorted, *coarse_, static_cast<std::size_t>(points() / kFarShare)),
        options_.threads);
    count_bricks(std::move(parts));
    return coarse_->size() > fitting(work_bytes()) ? sample_coarse() : Done{};
  }

  /// Halves the lattice's cube along its Morton curve until each part and what is around it fits.
  Status choose_regions() {
    const auto cubes = static_cast<std::uint64_t>(frame_.lattice().last_brick) + 1;
    const int bits = 3 * static_cast<int>(std::bit_width(cubes - 1));
    std::vector<std::size_t> all(cells_.size());
    for (std::size_t cell = 0; cell < all.size(); ++cell) all[cell] = cell;
    return divide(0, bits, all);
  }
  Status divide(std::uint64_t first_code, int bits, const std::vector<std::size_t>& among) {
    BrickRegion region;
    region.box_mm = frame_.points.box_mm;
    region.coarser = frame_.coarser;
    region.low = search::coordinate_of_code(first_code);
    region.past = search::coordinate_of_code(first_code | ((std::uint64_t{1} << bits) - 1));
    for (std::int32_t& past : region.past) ++past;
    // A point's cubes are its own and those beside it.
    const geometry::Aabb box = region_mm(region), beside = region_mm(region.grown(1)),
                         around = box.grown(frame_.margin_mm());
    std::vector<std::size_t> near;
    std::uint64_t points = 0;
    double bytes = 0.0;
    bool any = false;
    for (const std::size_t cell : among) {
      const geometry::Aabb of = cell_box_mm(cell);
      if (!of.overlaps(around)) continue;
      near.push_back(cell);
      const std::uint64_t own = (cells_.entry(cell).points + step_ - 1) / step_;
      points += own;
      bytes += static_cast<double>(own) * bytes_of_run_[cell / run_];
      any = any || of.overlaps(beside);
    }
    if (!any) return Done{};
    if (points <= options_.most_chunk_points && bytes <= region_bytes()) {
      regions_.push_back(region);
      return Done{};
    }
    // A smaller part would have as much around it.
    if (box.extent_mm().maxCoeff() < 0.5 * frame_.margin_mm() || bits == 0)
      return over_memory_limit(fmt::format("the surface of {} points around one place", format_count(points)),
                               options_.memory_bytes);
    PALPATE_TRY(divide(first_code, bits - 1, near));
    return divide(first_code | std::uint64_t{1} << (bits - 1), bits - 1, near);
  }

  Status write_joined(const ChunkScratch& scratch, spline_sdf::SurfaceFileWriter& writer) {
    progress_.report("joining", 1.0);
    spline_sdf::SplineSdf surface;
    surface.grid = frame_.lattice();
    const BrickGrid& grid = surface.grid;
    PALPATE_ASSIGN(
        const spline_sdf::JoinedChunks joined,
        spline_sdf::join_chunks(scratch, surface.grid, options_.build.both_sides, options_.threads));
    spline_sdf::SampleDistances distances;
    for (std::size_t c = 0; c < scratch.chunks().size(); ++c) {
      const spline_sdf::SurfaceChunk& chunk = scratch.chunks()[c];
      surface.cubes += scratch.counts(c)[static_cast<std::size_t>(grid.coarser)];
      surface.patches += chunk.patches;
      distances.squares += chunk.distances.squares;
      distances.count += chunk.distances.count;
    }
    surface.spacing_mm = frame_.measured.spacing_mm;
    surface.noise_mm = frame_.measured.noise_mm;
    report_.contradicted = joined.contradicted;
    report_.patches = surface.patches;
    ChunkTiles tiles(scratch, grid);
    report_.bricks = scratch.bricks();
    const auto brick = [&](std::uint32_t number, spline_sdf::Brick& out) {
      return tiles.read(number, joined, out);
    };
    return writer.add(
        surface, [&](const spline_sdf::TileSink& sink) { return tiles.cut(sink); }, brick, distances,
        options_.threads);
  }

  const CellFile& cells_;
  const PrepareSurfaceOptions& options_;
  std::string path_;
  std::uint64_t step_ = 1, coarse_step_ = 1;
  std::size_t run_ = 1;               ///< cells of a run
  std::vector<double> bytes_of_run_;  ///< a point, to make the surface
  double bytes_per_point_ = kSurfaceBytesPerPoint;
  Progress& progress_;
  std::vector<std::uint64_t> firsts_;  ///< number of each cell's first point
  Vec3 origin_mm_;
  spline_sdf::SurfaceFrame frame_;
  std::shared_ptr<const cloud::Cloud> coarse_;  ///< every coarse_step_th point
  std::vector<BrickRegion> regions_;            ///< in Morton order
  PrepareSurfaceReport report_;
  std::vector<std::byte> bytes_;
  CellPoints read_;
};

}  // namespace

Result<PrepareSurfaceReport> prepare_surface(const CellFile& cells, const PrepareSurfaceOptions& options,
                                             const std::string& path, Progress& progress) {
  std::optional<spline_sdf::SurfaceFileWriter> writer;
  PrepareSurfaceReport report;
  bool is_last = false;
  for (std::uint64_t step = 1; !is_last; step *= spline_sdf::kCoarserShare) {
    SurfacePreparation one(cells, options, path, step, progress);
    PALPATE_TRY(one.add_to(writer, is_last));
    if (step == 1) report = one.report();
  }
  PALPATE_TRY(writer->finish());
  // Also what a run with less memory left.
  for (std::uint64_t step = 1; step <= cells.info().points; step *= spline_sdf::kCoarserShare)
    std::remove(chunk_path(path, step).c_str());
  return report;
}

}  // namespace palpate::prepared
