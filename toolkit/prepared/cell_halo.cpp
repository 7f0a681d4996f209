#include "toolkit/prepared/cell_halo.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/prepared/cell_partition.h"

namespace palpate::prepared {
namespace {

/// Cells made at once: some hundred milliseconds of work, and a quarter of a million points in memory.
constexpr std::size_t kCellsAtOnce = 256;

Vec3 real_of(const LatticePoint& p) noexcept {
  return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}

double distance_sq(const geometry::Aabb& a, const geometry::Aabb& b) noexcept {
  double sq = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double gap = std::max({a.low_mm[axis] - b.high_mm[axis], b.low_mm[axis] - a.high_mm[axis], 0.0});
    sq += gap * gap;
  }
  return sq;
}

double distance_sq(const geometry::Aabb& box, const Vec3& p) noexcept {
  return distance_sq(box, geometry::Aabb{p, p});
}

struct HaloPoint {
  double sq = 0.0;
  LatticePoint at{};
};

/// Keeps the nearest, all that are nearer than the first one left out, and returns its squared distance.
double keep_nearest(std::vector<HaloPoint>& halo) {
  std::vector<double> sq(halo.size());
  std::transform(halo.begin(), halo.end(), sq.begin(), [](const HaloPoint& p) { return p.sq; });
  const auto first_out = sq.begin() + kMostHaloPoints;
  std::nth_element(sq.begin(), first_out, sq.end());
  const double limit = *first_out;
  std::erase_if(halo, [&](const HaloPoint& p) { return !(p.sq < limit); });
  return limit;
}

void write_steps(ByteWriter& writer, const LatticePoint& at, const CellEntry& entry) noexcept {
  for (std::size_t axis = 0; axis < 3; ++axis)
    writer.u16(static_cast<std::uint16_t>((at[axis] >> entry.shift) - entry.base[axis]));
}

}  // namespace

HaloMaker::HaloMaker(const std::vector<CellEntry>& cells, const CellLattice& lattice,
                     const PointScratch& scratch, std::size_t memory_bytes, int threads)
    : cells_(&cells),
      lattice_(lattice),
      scratch_(&scratch),
      most_loaded_(memory_bytes / sizeof(LatticePoint)),
      threads_(threads),
      firsts_(cells.size()) {
  std::vector<geometry::Aabb> boxes(cells.size());
  std::uint64_t first = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    boxes[i] = {real_of(cells[i].low), real_of(cells[i].high)};
    firsts_[i] = first;
    first += cells[i].points;
  }
  boxes_ = BoxTree(std::move(boxes));
}

HaloMaker::Surrounding HaloMaker::surrounding(std::size_t cell) const {
  struct Near {
    double sq;
    std::uint32_t cell;
  };
  Surrounding around;
  around.distance = std::ldexp((*cells_)[cell].halo_mm, -lattice_.unit_exponent);
  const geometry::Aabb& own = boxes_.box(cell);
  std::vector<Near> near;
  boxes_.visit_overlapping(own.grown(around.distance), [&](std::size_t other) {
    const double sq = distance_sq(own, boxes_.box(other));
    if (other == cell || !(sq < around.distance * around.distance)) return;
    near.push_back({sq, static_cast<std::uint32_t>(other)});
    around.points += (*cells_)[other].points;
  });
  if (around.points > kMostCandidates) {
    std::sort(near.begin(), near.end(),
              [](const Near& a, const Near& b) { return a.sq != b.sq ? a.sq < b.sq : a.cell < b.cell; });
    around.points = 0;
    std::size_t kept = 0;
    while (around.points + (*cells_)[near[kept].cell].points <= kMostCandidates)
      around.points += (*cells_)[near[kept++].cell].points;
    // All points of the cells left out are at least so far.
    around.distance = std::sqrt(near[kept].sq);
    near.resize(kept);
  }
  for (const Near& n : near) around.cells.push_back(n.cell);
  std::sort(around.cells.begin(), around.cells.end());
  return around;
}

Result<HaloMaker::LoadedCell> HaloMaker::read(std::uint32_t cell) const {
  std::vector<PackedPoint> packed((*cells_)[cell].points);
  PALPATE_TRY(scratch_->read_sorted(firsts_[cell], packed));
  LoadedCell one;
  one.points.resize(packed.size());
  one.blocks.resize((packed.size() + kBlock - 1) / kBlock);
  for (std::size_t i = 0; i < packed.size(); ++i) {
    one.points[i] = packed[i].point();
    one.blocks[i / kBlock].add(real_of(one.points[i]));
  }
  return one;
}

Status HaloMaker::load(const std::vector<std::uint32_t>& needed) {
  std::vector<std::uint32_t> missing;
  std::uint64_t missing_points = 0;
  for (const std::uint32_t cell : needed) {
    if (loaded_.contains(cell)) continue;
    missing.push_back(cell);
    missing_points += (*cells_)[cell].points;
  }
  if (loaded_points_ + missing_points > most_loaded_) {
    std::erase_if(loaded_, [&](const auto& one) {
      const bool drop = !std::binary_search(needed.begin(), needed.end(), one.first);
      if (drop) loaded_points_ -= one.second->points.size();
      return drop;
    });
  }
  std::vector<std::unique_ptr<LoadedCell>> made(missing.size());
  std::vector<std::optional<Error>> errors(missing.size());
  parallel_chunks(missing.size(), 1, threads_, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Result<LoadedCell> one = read(missing[i]);
      if (one)
        made[i] = std::make_unique<LoadedCell>(*std::move(one));
      else
        errors[i] = std::move(one).error();
    }
  });
  for (std::size_t i = 0; i < missing.size(); ++i) {
    if (errors[i]) return *errors[i];
    loaded_points_ += made[i]->points.size();
    loaded_.emplace(missing[i], std::move(made[i]));
  }
  return Done{};
}

HaloMaker::MadeCell HaloMaker::make(std::size_t cell, const Surrounding& around) const {
  MadeCell made;
  CellEntry& entry = made.entry;
  entry = (*cells_)[cell];
  const geometry::Aabb& own = boxes_.box(cell);
  const double limit_sq = around.distance * around.distance;
  std::vector<HaloPoint> halo;
  for (const std::uint32_t other : around.cells) {
    const LoadedCell& there = loaded(other);
    for (std::size_t block = 0; block < there.blocks.size(); ++block) {
      if (!(distance_sq(own, there.blocks[block]) < limit_sq)) continue;
      const std::size_t past = std::min((block + 1) * kBlock, there.points.size());
      for (std::size_t i = block * kBlock; i < past; ++i) {
        const double sq = distance_sq(own, real_of(there.points[i]));
        if (sq < limit_sq) halo.push_back({sq, there.points[i]});
      }
    }
  }
  double distance = around.distance;
  if (halo.size() > kMostHaloPoints) distance = std::sqrt(keep_nearest(halo));
  entry.halo_mm = std::ldexp(distance, lattice_.unit_exponent);
  entry.halo = static_cast<std::uint32_t>(halo.size());
  LatticePoint low = entry.low, high = entry.high;
  for (const HaloPoint& p : halo)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], p.at[axis]);
      high[axis] = std::max(high[axis], p.at[axis]);
    }
  entry.shift = quantum_shift(low, high);
  for (std::size_t axis = 0; axis < 3; ++axis) entry.base[axis] = low[axis] >> entry.shift;
  made.bytes.resize(static_cast<std::size_t>(entry.bytes()));
  ByteWriter writer{std::span(made.bytes)};
  for (const LatticePoint& p : loaded(cell).points) write_steps(writer, p, entry);
  for (const HaloPoint& p : halo) write_steps(writer, p.at, entry);
  Hash64 hash;
  hash.bytes(made.bytes);
  entry.hash = hash.value();
  return made;
}

Result<std::vector<HaloMaker::MadeCell>> HaloMaker::make_from(std::size_t first) {
  std::vector<Surrounding> around(std::min(kCellsAtOnce, cells_->size() - first));
  parallel_chunks(around.size(), 1, threads_, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) around[i] = surrounding(first + i);
  });
  // Fewer cells where all that they need together does not fit.
  std::size_t count = around.size();
  std::vector<std::uint32_t> needed;
  for (bool fits = false; !fits;) {
    needed.clear();
    for (std::size_t i = 0; i < count; ++i) {
      needed.push_back(static_cast<std::uint32_t>(first + i));
      needed.insert(needed.end(), around[i].cells.begin(), around[i].cells.end());
    }
    std::sort(needed.begin(), needed.end());
    needed.erase(std::unique(needed.begin(), needed.end()), needed.end());
    std::uint64_t points = 0;
    for (const std::uint32_t cell : needed) points += (*cells_)[cell].points;
    fits = points <= most_loaded_ || count == 1;
    if (!fits) count = (count + 1) / 2;
  }
  PALPATE_TRY(load(needed));
  std::vector<MadeCell> made(count);
  parallel_chunks(count, 1, threads_, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) made[i] = make(first + i, around[i]);
  });
  return made;
}

}  // namespace palpate::prepared
