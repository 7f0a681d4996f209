#include "toolkit/prepared/point_passes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/core/tolerances.h"

namespace palpate::prepared {
namespace {

/// Points read at once, 6 MB: a thousandth of a large scan, so that reports come often.
constexpr std::size_t kBatchPoints = std::size_t{1} << 18;

bool usable(const Vec3& p) noexcept {
  // Comparisons with what is not a number are false.
  return std::abs(p.x()) <= kLengthsMm.high && std::abs(p.y()) <= kLengthsMm.high &&
         std::abs(p.z()) <= kLengthsMm.high;
}

}  // namespace

Error PointPasses::changed() {
  return Error{"the input gave other points the second time it was read",
               "prepare it again when nothing writes to it"};
}

std::optional<geometry::Aabb> PointPasses::promised_bounds_mm() const {
  if (!stream_->header().bounds) return std::nullopt;
  const geometry::Aabb box{mm_per_unit_ * stream_->header().bounds->low_mm,
                           mm_per_unit_ * stream_->header().bounds->high_mm};
  if (!usable(box.low_mm) || !usable(box.high_mm) || (box.low_mm.array() > box.high_mm.array()).any())
    return std::nullopt;
  return box;
}

Status PointPasses::for_each_batch(std::string_view what, const Batch& work) {
  if (passes_++ > 0) PALPATE_TRY(stream_->rewind());
  std::array<std::vector<Vec3>, 2> buffers{std::vector<Vec3>(kBatchPoints), std::vector<Vec3>(kBatchPoints)};
  const auto promised = static_cast<double>(stream_->header().points);
  double seen = 0.0;
  PALPATE_ASSIGN(std::size_t have, stream_->read(buffers[0]));
  for (std::size_t current = 0; have > 0; current = 1 - current) {
    if (progress_->cancelled()) return Error{"preparing was stopped", "run it again to go on"};
    progress_->report(what, promised > 0.0 ? std::min(seen / promised, 1.0) : -1.0);
    seen += static_cast<double>(have);
    Result<std::size_t> next = std::size_t{0};
    Status worked = Done{};
    parallel_chunks(2, 1, threads_, [&](std::size_t task, std::size_t) {
      if (task == 0)
        worked = work(std::span(buffers[current]).first(have));
      else
        next = stream_->read(buffers[1 - current]);
    });
    PALPATE_TRY(std::move(worked));
    PALPATE_TRY(next);
    have = *next;
  }
  return Done{};
}

void PointPasses::locate(std::span<Vec3> points, const CellLattice* lattice, const CountTree& tree,
                         std::vector<Located>& located, PassFindings& findings) const {
  located.resize(points.size());
  std::vector<PassFindings> parts((points.size() + kPointsPerChunk - 1) / kPointsPerChunk);
  const double per_mm = lattice != nullptr ? std::ldexp(1.0, -lattice->unit_exponent) : 0.0;
  parallel_chunks(points.size(), kPointsPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
    PassFindings part;
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3 p = mm_per_unit_ * points[i];
      located[i].there = false;
      if (!usable(p)) {
        ++part.dropped;
        continue;
      }
      ++part.points;
      part.bounds_mm.add(p);
      if (lattice == nullptr) continue;
      LatticePoint at{};
      if (lattice->locate(p, per_mm, at))
        located[i] = {PackedPoint::of(at), tree.find(at), true};
      else
        ++part.outside;
    }
    parts[begin / kPointsPerChunk] = part;
  });
  for (const PassFindings& part : parts) {
    findings.points += part.points;
    findings.dropped += part.dropped;
    findings.outside += part.outside;
    findings.bounds_mm.add(part.bounds_mm);
  }
}

Result<PassFindings> PointPasses::count(const std::optional<CellLattice>& lattice, CountTree& tree) {
  PassFindings findings;
  std::vector<Located> located;
  PALPATE_TRY(for_each_batch("counting points", [&](std::span<Vec3> points) -> Status {
    locate(points, lattice ? &*lattice : nullptr, tree, located, findings);
    for (const Located& one : located)
      if (one.there) tree.count(one.place);
    return Done{};
  }));
  return findings;
}

Status PointPasses::scatter(const CellLattice& lattice, const CountTree& tree, PointScratch& scratch) {
  PassFindings findings;
  std::vector<Located> located;
  PALPATE_TRY(for_each_batch("scattering points", [&](std::span<Vec3> points) -> Status {
    locate(points, &lattice, tree, located, findings);
    if (findings.outside > 0) return changed();
    for (const Located& one : located) {
      if (!one.there) continue;
      const std::uint32_t region = tree.region(one.place);
      if (region == CountTree::kNone) return changed();
      PALPATE_ASSIGN(const bool room, scratch.add(region, one.point));
      if (!room) return changed();
    }
    return Done{};
  }));
  PALPATE_ASSIGN(const bool full, scratch.end_scatter());
  if (!full) return changed();
  return Done{};
}

}  // namespace palpate::prepared
