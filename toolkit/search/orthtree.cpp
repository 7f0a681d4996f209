#include "toolkit/search/orthtree.h"

#include <algorithm>

namespace palpate::search {
namespace {

/// The lattice of the smallest leaves: as fine as Morton codes allow.
Lattice finest(geometry::Aabb box, int axes, double stand_in_mm) {
  if (axes == 2) box.high_mm.z() = box.low_mm.z();
  constexpr double kCubes = static_cast<double>((1u << kMortonBits) - 2);  // as Lattice::over
  double extent = box.extent_mm().maxCoeff();
  // Coincident points have no extent; the tree then has the size of its queries.
  if (!(extent > 0.0)) extent = stand_in_mm;
  // A quotient rounded up would add a cube and make the lattice double them, losing half the depth.
  return Lattice::over(box, extent / kCubes * (1.0 + 2.0 * gamma(2)));
}

}  // namespace

template <int kAxes>
Orthtree<kAxes> Orthtree<kAxes>::build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                       int threads) {
  Orthtree tree;
  tree.lattice_ = finest(local_box(cloud, threads), kAxes, options.cell_mm);
  MortonOrder sorted = sort_by_morton(cloud, tree.lattice_, threads, kAxes);
  tree.order_ = std::move(sorted.order);
  const std::vector<std::uint64_t>& codes = sorted.codes;
  const int last_level = kMortonBits - std::clamp(options.max_depth, 0, kMortonBits);

  Nodes& nodes = tree.nodes_;
  nodes.push_back({0, static_cast<std::uint32_t>(codes.size()), 0});
  std::size_t level_begin = 0;
  for (int level = kMortonBits; level > last_level; --level) {
    const std::size_t level_end = nodes.size();
    const int shift = 3 * (level - 1);
    for (std::size_t at = level_begin; at < level_end; ++at) {
      if (nodes[at].end - nodes[at].begin <= options.max_points) continue;
      nodes[at].child = static_cast<std::uint32_t>(nodes.size());
      const std::uint32_t end = nodes[at].end;
      std::uint32_t begin = nodes[at].begin;
      for (std::uint64_t child = 0; child < kChildren; ++child) {
        // The codes of a node agree above `shift` + 3 bits.
        const auto next =
            std::partition_point(codes.begin() + begin, codes.begin() + end,
                                 [&](std::uint64_t code) { return (code >> shift & 7u) <= child; });
        const auto to = static_cast<std::uint32_t>(next - codes.begin());
        nodes.push_back({begin, to, 0});
        begin = to;
      }
    }
    level_begin = level_end;
  }
  nodes.shrink_to_fit();
  return tree;
}

template <int kAxes>
LeafStatistics Orthtree<kAxes>::statistics() const {
  LeafStatistics found;
  found.nodes = nodes_.size();
  std::size_t points = 0;
  // Children come after their parents, level by level.
  std::size_t level_begin = 0, level_end = 1;
  for (int depth = 0; level_begin < level_end; ++depth) {
    std::size_t below = 0;
    for (std::size_t at = level_begin; at < level_end; ++at) {
      const TreeNode& node = nodes_[at];
      if (node.child != 0) {
        below += kChildren;
        continue;
      }
      const std::uint32_t here = node.end - node.begin;
      if (here == 0) continue;
      ++found.leaves;
      points += here;
      found.max_points = std::max(found.max_points, here);
      found.max_depth = depth;
    }
    level_begin = level_end;
    level_end += below;
  }
  if (found.leaves > 0) found.mean_points = static_cast<double>(points) / static_cast<double>(found.leaves);
  return found;
}

template class Orthtree<2>;
template class Orthtree<3>;

}  // namespace palpate::search
