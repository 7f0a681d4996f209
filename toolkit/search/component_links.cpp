#include "toolkit/search/component_links.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include <palpate/aabb.h>

namespace palpate::search {
namespace {

constexpr std::uint32_t kMixed = std::numeric_limits<std::uint32_t>::max();
/// Points per leaf: their distances cost about as much as the boxes above.
constexpr std::uint32_t kLeaf = 12;

/// A k-d tree whose nodes know if their points are all of one piece.
class ComponentTree {
 public:
  explicit ComponentTree(const cloud::Cloud& cloud) : cloud_(cloud), order_(cloud.size()) {
    std::iota(order_.begin(), order_.end(), 0u);
    nodes_.reserve(2 * cloud.size() / kLeaf + 2);
    split(0, static_cast<std::uint32_t>(cloud.size()));
  }

  void label(std::span<const std::uint32_t> piece) {
    // Children are stored behind their parent.
    for (std::size_t at = nodes_.size(); at-- > 0;) {
      Node& node = nodes_[at];
      if (node.right == 0) {
        node.piece = piece[order_[node.begin]];
        for (std::uint32_t i = node.begin; i < node.end; ++i)
          if (piece[order_[i]] != node.piece) node.piece = kMixed;
      } else {
        const std::uint32_t left = nodes_[at + 1].piece;
        node.piece = left == nodes_[node.right].piece ? left : kMixed;
      }
    }
  }

  /// Replaces `best` by a shorter joint from `self` to another piece, if there is one.
  void shorten(std::uint32_t self, std::span<const std::uint32_t> piece, ComponentLink& best) const {
    visit(0, self, cloud_.local_mm(self), piece, best);
  }

 private:
  struct Node {
    Vec3 low, high;
    std::uint32_t begin = 0, end = 0;
    std::uint32_t right = 0;  ///< 0: a leaf; the left child is the next node
    std::uint32_t piece = kMixed;
  };

  void split(std::uint32_t begin, std::uint32_t end) {
    const std::size_t at = nodes_.size();
    nodes_.emplace_back();
    geometry::Aabb box;
    for (std::uint32_t i = begin; i < end; ++i) box.add(cloud_.local_mm(order_[i]));
    nodes_[at] = {box.low_mm, box.high_mm, begin, end, 0, kMixed};
    if (end - begin <= kLeaf) return;
    int axis = 0;
    box.extent_mm().maxCoeff(&axis);
    const std::vector<float>& along = axis == 0 ? cloud_.x_mm : axis == 1 ? cloud_.y_mm : cloud_.z_mm;
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(
        order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
        [&](std::uint32_t a, std::uint32_t b) { return along[a] != along[b] ? along[a] < along[b] : a < b; });
    split(begin, middle);
    nodes_[at].right = static_cast<std::uint32_t>(nodes_.size());
    split(middle, end);
  }

  [[nodiscard]] static double square_to(const Node& node, const Vec3& p) noexcept {
    return (node.low - p).cwiseMax(p - node.high).cwiseMax(0.0).squaredNorm();
  }

  void visit(std::size_t at, std::uint32_t self, const Vec3& p, std::span<const std::uint32_t> piece,
             ComponentLink& best) const {
    const Node& node = nodes_[at];
    if (node.piece == piece[self] || square_to(node, p) > best.square_mm2) return;
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        const std::uint32_t other = order_[i];
        if (piece[other] == piece[self]) continue;
        const ComponentLink joint{(cloud_.local_mm(other) - p).squaredNorm(), std::min(self, other),
                                  std::max(self, other)};
        if (joint < best) best = joint;
      }
      return;
    }
    const std::size_t left = at + 1, right = node.right;
    const bool left_first = square_to(nodes_[left], p) <= square_to(nodes_[right], p);
    visit(left_first ? left : right, self, p, piece, best);
    visit(left_first ? right : left, self, p, piece, best);
  }

  const cloud::Cloud& cloud_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace

std::vector<ComponentLink> shortest_component_links(const cloud::Cloud& cloud, OrientedDisjointSets& pieces,
                                                    std::size_t count) {
  std::vector<ComponentLink> joints;
  if (count < 2) return joints;
  ComponentTree tree(cloud);
  const std::size_t n = cloud.size();
  std::vector<std::uint32_t> piece(n), size(n);
  std::vector<ComponentLink> best(n);
  constexpr double kNone = std::numeric_limits<double>::infinity();
  while (count > 1) {
    std::fill(size.begin(), size.end(), 0u);
    for (std::size_t i = 0; i < n; ++i) ++size[piece[i] = pieces.find(static_cast<std::uint32_t>(i)).set];
    const auto largest =
        static_cast<std::uint32_t>(std::max_element(size.begin(), size.end()) - size.begin());
    tree.label(piece);
    std::fill(best.begin(), best.end(), ComponentLink{kNone, 0, 0});
    for (std::uint32_t i = 0; i < n; ++i)
      if (piece[i] != largest) tree.shorten(i, piece, best[piece[i]]);
    for (const ComponentLink& joint : best)
      if (joint.square_mm2 != kNone && pieces.join(joint.a, joint.b) == OrientedDisjointSets::Joined::kNow) {
        joints.push_back(joint);
        --count;
      }
  }
  std::sort(joints.begin(), joints.end());
  return joints;
}

}  // namespace palpate::search
