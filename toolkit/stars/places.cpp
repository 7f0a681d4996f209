#include "toolkit/stars/places.h"

#include <algorithm>
#include <array>
#include <bit>

#include "toolkit/core/parallel.h"
#include "toolkit/core/radix_sort.h"
#include "toolkit/partition/morton_order.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {
namespace {

/// Cubes along the longest side of the lattice that sorts the points: all that a code holds, so that two
/// points share a cube only where they are one to a float.
constexpr double kSortingCubes = 2097151.0;  // 2^21 - 1
/// Bits of a code that are sorted by counting: three passes over eight bytes a point. They tell the points of
/// a million apart but for a few, and those few are sorted among themselves.
constexpr int kCountedBits = 32;
constexpr std::size_t kChunk = std::size_t{1} << 16;
/// Points of a group that are put in order among themselves. A Morton curve jumps, and a block of places that
/// lies across a jump has a box and a layer many times its neighbours': only blocks across the middle of a
/// group can.
constexpr std::size_t kGroup = 512;

struct Item {
  std::uint32_t key;  ///< the highest bits of its code
  std::uint32_t index;
};

struct Codes {
  const cloud::Cloud& cloud;
  geometry::Aabb box;
  partition::Lattice lattice;

  [[nodiscard]] std::uint64_t at(const Vec3& p) const noexcept {
    const auto along = [&](int axis) {
      return static_cast<std::uint32_t>((p[axis] - lattice.low_mm[axis]) * lattice.per_mm);
    };
    return partition::morton_code(along(0), along(1), along(2));
  }
  [[nodiscard]] std::uint64_t operator()(std::uint32_t i) const noexcept { return at(cloud.local_mm(i)); }
  /// Has the highest bit of any: coordinates along each axis grow with the place.
  [[nodiscard]] std::uint64_t highest() const noexcept { return at(box.high_mm); }
};

/// Sorted by the highest bits of the codes.
std::vector<Item> counted(const Codes& codes, int threads) {
  const std::size_t n = codes.cloud.size();
  const int below = std::max(0, 64 - std::countl_zero(codes.highest()) - kCountedBits);
  std::vector<Item> items(n);
  parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const auto i = static_cast<std::uint32_t>(k);
      items[k] = {static_cast<std::uint32_t>(codes(i) >> below), i};
    }
  });
  radix_sort(items, kCountedBits, threads, [](const Item& item) { return item.key; });
  return items;
}

std::array<float, 3> coordinates(const cloud::Cloud& cloud, std::uint32_t i) noexcept {
  return {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]};
}

/// Points with equal keys by the rest of their codes, then by coordinates, then by index; marks who stands
/// where the one before does.
void settle_runs(const Codes& codes, std::vector<Item>& items, std::vector<std::uint8_t>& doubled,
                 int threads) {
  const cloud::Cloud& cloud = codes.cloud;
  const std::size_t n = items.size();
  parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    // A chunk has the runs that begin in it.
    std::size_t i = begin;
    while (i > 0 && i < end && items[i].key == items[i - 1].key) ++i;
    struct Full {
      std::uint64_t code;
      std::array<float, 3> at;
      std::uint32_t index;
      bool operator<(const Full& o) const noexcept {
        if (code != o.code) return code < o.code;
        return at != o.at ? at < o.at : index < o.index;
      }
    };
    std::vector<Full> run;
    while (i < end) {
      std::size_t last = i + 1;
      while (last < n && items[last].key == items[i].key) ++last;
      if (last - i > 1) {
        run.clear();
        for (std::size_t k = i; k < last; ++k)
          run.push_back({codes(items[k].index), coordinates(cloud, items[k].index), items[k].index});
        std::sort(run.begin(), run.end());
        for (std::size_t k = 0; k < run.size(); ++k) {
          items[i + k].index = run[k].index;
          if (k > 0 && run[k].at == run[k - 1].at) doubled[run[k].index] = 1;
        }
      }
      i = last;
    }
  });
}

struct Member {
  std::array<float, 3> at;
  std::uint32_t index;
};

/// Halves the range across its longest side, down to blocks.
void split(Member* first, Member* last) {
  const auto count = static_cast<std::size_t>(last - first);
  if (count <= kBlockPlaces) return;
  std::array<float, 3> low = first->at, high = low;
  for (const Member* m = first; m != last; ++m)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], m->at[axis]);
      high[axis] = std::max(high[axis], m->at[axis]);
    }
  std::size_t longest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (high[axis] - low[axis] > high[longest] - low[longest]) longest = axis;
  const std::size_t blocks = (count + kBlockPlaces - 1) / kBlockPlaces;
  Member* const middle = first + (blocks + 1) / 2 * kBlockPlaces;
  if (middle >= last) return;
  std::nth_element(first, middle, last, [longest](const Member& a, const Member& b) {
    if (a.at[longest] != b.at[longest]) return a.at[longest] < b.at[longest];
    return a.at != b.at ? a.at < b.at : a.index < b.index;
  });
  split(first, middle);
  split(middle, last);
}

}  // namespace

Places sort_places(const cloud::Cloud& cloud, int threads) {
  const std::size_t n = cloud.size();
  const geometry::Aabb box = partition::local_box(cloud, threads);
  const double extent = box.extent_mm().maxCoeff();
  const Codes codes{cloud, box, partition::Lattice::over(box, extent > 0.0 ? extent / kSortingCubes : 1.0)};
  std::vector<std::uint8_t> doubled(n, 0);
  std::vector<Item> items = counted(codes, threads);
  settle_runs(codes, items, doubled, threads);
  Places places;
  places.point.resize(n);
  places.order.resize(n);
  places.doubled.resize(n);
  parallel_chunks(n, kGroup, threads, [&](std::size_t begin, std::size_t end) {
    std::array<Member, kGroup> group;
    for (std::size_t k = begin; k < end; ++k)
      group[k - begin] = {coordinates(cloud, items[k].index), items[k].index};
    split(group.data(), group.data() + (end - begin));
    for (std::size_t k = begin; k < end; ++k) {
      const Member& member = group[k - begin];
      places.point[k] = {member.at[0], member.at[1], member.at[2], 0.0F};
      places.order[k] = member.index;
      places.doubled[k] = doubled[member.index];
    }
  });
  return places;
}

}  // namespace palpate::stars
