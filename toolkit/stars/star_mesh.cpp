#include "toolkit/stars/star_mesh.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/parallel.h"
#include "toolkit/partition/morton_order.h"
#include "toolkit/stars/draft.h"
#include "toolkit/stars/fill.h"
#include "toolkit/stars/turn.h"

namespace palpate::stars {
namespace {

/// Cubes along the longest side of the lattice that sorts the points: all that a code holds, so that two
/// points share a cube only where they are one to a float.
constexpr double kSortingCubes = 2097151.0;  // 2^21 - 1

cloud::Cloud sorted_cloud(const cloud::Cloud& cloud, const std::vector<std::uint32_t>& order, int threads) {
  cloud::Cloud sorted;
  sorted.origin_mm = cloud.origin_mm;
  const std::size_t n = cloud.size();
  sorted.x_mm.resize(n);
  sorted.y_mm.resize(n);
  sorted.z_mm.resize(n);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      sorted.x_mm[i] = cloud.x_mm[order[i]];
      sorted.y_mm[i] = cloud.y_mm[order[i]];
      sorted.z_mm[i] = cloud.z_mm[order[i]];
    }
  });
  return sorted;
}

/// Points of a group that are put in order among themselves. A Morton curve jumps, and a block of places that
/// lies across a jump has a box and a layer many times its neighbours': only blocks across the middle of a
/// group can.
constexpr std::size_t kGroup = 512;

/// Halves the range across its longest side, down to blocks.
void split(const cloud::Cloud& cloud, std::uint32_t* first, std::uint32_t* last) {
  const auto count = static_cast<std::size_t>(last - first);
  if (count <= kBlockPlaces) return;
  const auto at = [&](std::uint32_t i) { return std::array{cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]}; };
  std::array<float, 3> low = at(*first), high = low;
  for (const std::uint32_t* i = first; i != last; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], at(*i)[axis]);
      high[axis] = std::max(high[axis], at(*i)[axis]);
    }
  std::size_t longest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (high[axis] - low[axis] > high[longest] - low[longest]) longest = axis;
  const std::size_t blocks = (count + kBlockPlaces - 1) / kBlockPlaces;
  std::uint32_t* const middle = first + (blocks + 1) / 2 * kBlockPlaces;
  if (middle >= last) return;
  std::nth_element(first, middle, last, [&](std::uint32_t i, std::uint32_t j) {
    const auto a = at(i), b = at(j);
    if (a[longest] != b[longest]) return a[longest] < b[longest];
    return a != b ? a < b : i < j;
  });
  split(cloud, first, middle);
  split(cloud, middle, last);
}

std::vector<std::uint32_t> places_of(const cloud::Cloud& cloud, int threads) {
  const geometry::Aabb box = partition::local_box(cloud, threads);
  const double extent = box.extent_mm().maxCoeff();
  const partition::Lattice lattice =
      partition::Lattice::over(box, extent > 0.0 ? extent / kSortingCubes : 1.0);
  std::vector<std::uint32_t> order = partition::sort_by_morton(cloud, lattice, threads).order;
  parallel_chunks(order.size(), kGroup, threads, [&](std::size_t begin, std::size_t end) {
    split(cloud, order.data() + begin, order.data() + end);
  });
  return order;
}

}  // namespace

class StarMeshBuilder {
 public:
  StarMeshBuilder(const cloud::Cloud& cloud, int threads, const OnStep& on_step)
      : threads_(threads), on_step_(on_step) {
    step("sort");
    mesh_.order_ = places_of(cloud, threads);
    sorted_ = sorted_cloud(cloud, mesh_.order_, threads);
    mesh_.origin_mm_ = cloud.origin_mm;
    draft_.cloud = &sorted_;
    draft_.threads = threads;
  }

  StarMesh build() {
    StarCounts& counts = mesh_.counts_;
    step("neighbours");
    find_near(draft_);
    step("stars");
    make_stars(draft_);
    step("mend");
    mend_stars(draft_);
    step("fill");
    for (std::size_t i = 0; i < draft_.size(); ++i) {
      counts.agreed_points += draft_.star[i].closed_and_agreed();
      counts.welded += draft_.welded[i];
    }
    const FillReport filled = fill_gaps(draft_);
    counts.voted = filled.voted;
    counts.filled = filled.filled;
    step("sides");
    pieces_ = turn_stars(draft_);
    counts.torn = pieces_.torn;
    counts.pieces = pieces_.closed.size();
    step("store");
    store();
    return std::move(mesh_);
  }

 private:
  void step(std::string_view name) const {
    if (on_step_) on_step_(name);
  }
  void store() {
    const std::size_t n = draft_.size();
    StarCounts& counts = mesh_.counts_;
    std::vector<std::uint32_t> closed_number(pieces_.closed.size(), 0);
    for (std::size_t p = 0; p < pieces_.closed.size(); ++p)
      if (pieces_.closed[p] != 0) closed_number[p] = static_cast<std::uint32_t>(counts.closed_pieces++);
    std::vector<std::uint32_t> long_at(n, 0);
    std::uint32_t long_size = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const Star& star = draft_.star[i];
      counts.triangles += star.sectors();
      counts.unused += static_cast<std::uint64_t>(star.sectors() == 0 && draft_.welded[i] == 0);
      counts.open_points += static_cast<std::uint64_t>(star.sectors() > 0 && star.open != 0);
      if (star.size > kShortRing) {
        long_at[i] = long_size;
        long_size += star.size;
      }
    }
    counts.triangles /= 3;
    mesh_.points_.resize(n);
    mesh_.rings_.resize(n);
    mesh_.long_rings_.resize(long_size);
    if (counts.closed_pieces > 1) mesh_.closed_piece_of_.assign(n, 0);
    parallel_chunks(n, kPointsPerChunk, threads_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const Star& star = draft_.star[i];
        const bool closed = pieces_.of[i] != kNoPoint && pieces_.closed[pieces_.of[i]] != 0;
        std::uint32_t info = closed ? StarMesh::kClosed : 0;
        auto& row = mesh_.rings_[i];
        if (star.size > kShortRing) {
          info |= StarMesh::kLong;
          std::copy_n(star.ring.begin(), star.size, mesh_.long_rings_.begin() + long_at[i]);
          row.fill(static_cast<std::uint32_t>(i));
          row[0] = long_at[i];
          row[1] = star.size;
          row[2] = star.open;
        } else {
          info |= star.size | (star.open << StarMesh::kOpenShift);
          row.fill(static_cast<std::uint32_t>(i));
          std::copy_n(star.ring.begin(), star.size, row.begin());
        }
        mesh_.points_[i] = {sorted_.x_mm[i], sorted_.y_mm[i], sorted_.z_mm[i], info};
        if (closed && !mesh_.closed_piece_of_.empty())
          mesh_.closed_piece_of_[i] = closed_number[pieces_.of[i]];
      }
    });
  }

  int threads_;
  const OnStep& on_step_;
  cloud::Cloud sorted_;
  Draft draft_;
  Pieces pieces_;
  StarMesh mesh_;
};

StarMesh StarMesh::build(const cloud::Cloud& cloud, int threads, const OnStep& on_step) {
  return StarMeshBuilder(cloud, threads, on_step).build();
}

std::size_t StarMesh::bytes() const noexcept {
  return points_.capacity() * sizeof(StarPoint) + rings_.capacity() * sizeof(rings_[0]) +
         (long_rings_.capacity() + closed_piece_of_.capacity() + order_.capacity()) * sizeof(std::uint32_t);
}

geometry::TriangleMesh StarMesh::as_mesh() const {
  geometry::TriangleMesh mesh;
  mesh.vertices_mm.resize(size());
  for (std::uint32_t i = 0; i < size(); ++i) mesh.vertices_mm[order_[i]] = at(i) + origin_mm_;
  mesh.triangles.reserve(counts_.triangles);
  for (std::uint32_t i = 0; i < size(); ++i)
    for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      mesh.triangles.push_back({order_[a], order_[b], order_[c]});
    });
  return mesh;
}

}  // namespace palpate::stars
