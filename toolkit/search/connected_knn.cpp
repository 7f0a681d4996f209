#include "toolkit/search/knn.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <queue>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include "toolkit/core/disjoint_sets.h"
#include "toolkit/core/parallel.h"
#include "toolkit/search/knn_kernels.h"

namespace palpate::search {
namespace {

struct ComponentLink {
  double square_mm2 = 0.0;
  std::uint32_t a = 0, b = 0;  ///< a < b
  friend bool operator<(const ComponentLink& x, const ComponentLink& y) noexcept {
    if (x.square_mm2 != y.square_mm2) return x.square_mm2 < y.square_mm2;
    return x.a != y.a ? x.a < y.a : x.b < y.b;
  }
};

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

/// Joins all `count` pieces by the shortest set of links, ties by (a, b): pieces - 1 links, in order.
/// Boruvka's rounds: every piece but the largest takes its closest other, so their number at least halves.
/// O(n log n) a round.
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

/// "The fourth of their own": half of eight.
constexpr std::size_t kHalf = kNeighbours / 2;
constexpr std::size_t kNoSlot = kNeighbours;

/// Grows a tree of links from the first point until it holds every point.
class Growth {
 public:
  Growth(const cloud::Cloud& cloud, NeighbourTable& table)
      : cloud_(cloud), table_(table), reached_(table.size(), 0), hung_(table.size(), 0) {
    reach(0);
    spread();
  }
  [[nodiscard]] std::uint64_t unreached() const {
    return static_cast<std::uint64_t>(std::count(reached_.begin(), reached_.end(), 0));
  }

  /// Continues with links that join all pieces.
  void go_on(const std::vector<ComponentLink>& joints, ConnectReport& report) {
    for (std::uint32_t w = 0; w < table_.size(); ++w)
      if (reached_[w] == 0)
        for (const std::uint32_t v : table_.of[w])
          if (v != w) offers_.push_back({v, w, false});
    for (const ComponentLink& joint : joints) {
      offers_.push_back({joint.a, joint.b, true});
      offers_.push_back({joint.b, joint.a, true});
    }
    std::sort(offers_.begin(), offers_.end());
    for (const Offer& offer : offers_)
      if (reached_[offer.from] != 0) enqueue(offer);
    growing_ = true;
    while (!waiting_.empty()) {
      const Wait next = waiting_.top();
      waiting_.pop();
      if (reached_[next.to] != 0) continue;
      hang(next.from, next.to, report);
      if (next.joint) give_back(next.to, next.from, report);
      reach(next.to);
      spread();
    }
    for (const std::uint32_t point : changed_) sort_row(point);
  }

 private:
  /// `to` can be reached from `from`.
  struct Offer {
    std::uint32_t from = 0, to = 0;
    bool joint = false;  ///< between pieces
    friend bool operator<(const Offer& x, const Offer& y) noexcept {
      return x.from != y.from ? x.from < y.from : x.to < y.to;
    }
  };
  struct Wait {
    double square = 0.0;
    std::uint32_t from = 0, to = 0;
    bool joint = false;
    friend bool operator<(const Wait& x, const Wait& y) noexcept {
      // A priority queue pops the largest: inverted, the shortest.
      if (x.square != y.square) return x.square > y.square;
      return x.to != y.to ? x.to > y.to : x.from > y.from;
    }
  };

  [[nodiscard]] double square(std::uint32_t a, std::uint32_t b) const noexcept {
    return (cloud_.local_mm(a) - cloud_.local_mm(b)).squaredNorm();
  }
  void enqueue(const Offer& offer) {
    if (reached_[offer.to] == 0)
      waiting_.push({square(offer.from, offer.to), offer.from, offer.to, offer.joint});
  }
  void reach(std::uint32_t point) {
    reached_[point] = 1;
    queue_.push(point);
  }
  void spread() {
    for (; !queue_.empty(); queue_.pop()) {
      const std::uint32_t v = queue_.front();
      for (std::size_t k = 0; k < kNeighbours; ++k) {
        const std::uint32_t u = table_.of[v][k];
        if (reached_[u] != 0) continue;
        hung_[v] = static_cast<std::uint8_t>(hung_[v] | 1u << k);
        reach(u);
      }
      if (!growing_) continue;
      for (auto at = std::lower_bound(offers_.begin(), offers_.end(), Offer{v, 0, false});
           at != offers_.end() && at->from == v; ++at)
        enqueue(*at);
    }
  }
  /// A free slot, or that of the farthest link not used by the tree.
  [[nodiscard]] std::size_t slot_of(std::uint32_t v) const noexcept {
    std::size_t best = kNoSlot;
    double far = -1.0;
    for (std::size_t k = 0; k < kNeighbours; ++k) {
      if (table_.of[v][k] == v) return k;
      if ((hung_[v] >> k & 1u) != 0) continue;
      const double sq = square(v, table_.of[v][k]);
      if (sq >= far) {
        best = k;
        far = sq;
      }
    }
    return best;
  }
  void put(std::uint32_t v, std::size_t slot, std::uint32_t u, ConnectReport& report) {
    table_.of[v][slot] = u;
    hung_[v] = static_cast<std::uint8_t>(hung_[v] | 1u << slot);
    changed_.push_back(v);
    ++report.links_given;
    report.longest_link_mm = std::max(report.longest_link_mm, std::sqrt(square(v, u)));
  }
  /// Attaches u to v; if the tree uses all of v's links, to the nearest child, recursively. The tree has
  /// leaves, so a slot exists. Ties rotate by point, so piles form no chain.
  void hang(std::uint32_t v, std::uint32_t u, ConnectReport& report) {
    std::size_t turn = u;
    for (std::size_t slot = slot_of(v);; slot = slot_of(v)) {
      if (slot != kNoSlot) return put(v, slot, u, report);
      std::size_t nearest = turn % kNeighbours;
      for (std::size_t k = 0; k < kNeighbours; ++k) {
        const std::size_t at = (turn + k) % kNeighbours;
        if (square(table_.of[v][at], u) < square(table_.of[v][nearest], u)) nearest = at;
      }
      v = table_.of[v][nearest];
      turn /= kNeighbours;
    }
  }
  /// The link back over a joint, before anything is attached to v. The point that v's farthest link reached
  /// waits for another.
  void give_back(std::uint32_t v, std::uint32_t u, ConnectReport& report) {
    const std::size_t slot = slot_of(v);
    const std::uint32_t lost = table_.of[v][slot];
    put(v, slot, u, report);
    if (lost != v) enqueue({v, lost, false});
  }
  void sort_row(std::uint32_t v) {
    NearestEight sorted;
    for (const std::uint32_t u : table_.of[v])
      if (u != v) sorted.offer(square(v, u), u);
    sorted.store(v, table_.of[v]);
  }

  const cloud::Cloud& cloud_;
  NeighbourTable& table_;
  std::vector<std::uint8_t> reached_;
  std::vector<std::uint8_t> hung_;  ///< a bit per link that the tree uses
  std::queue<std::uint32_t> queue_;
  std::vector<Offer> offers_;
  std::priority_queue<Wait> waiting_;
  std::vector<std::uint32_t> changed_;
  bool growing_ = false;
};

/// Distance to the fourth neighbour or the last; 0 without any. Builders may order rows by other distances.
double fourth_mm(const cloud::Cloud& cloud, const NeighbourTable& table, std::uint32_t point) noexcept {
  const std::size_t count = table.count(point);
  if (count == 0) return 0.0;
  const std::uint32_t other = table.of[point][std::min(count, kHalf) - 1];
  return (cloud.local_mm(other) - cloud.local_mm(point)).norm();
}

double local_spacing_mm(const NeighbourTable& table, const std::vector<double>& fourth,
                        std::uint32_t point) noexcept {
  std::array<double, kNeighbours + 1> values;
  std::size_t n = 0;
  values[n++] = fourth[point];
  for (const std::uint32_t other : table.of[point])
    if (other != point) values[n++] = fourth[other];
  std::nth_element(values.begin(), values.begin() + n / 2, values.begin() + n);
  return values[n / 2];
}

}  // namespace

ConnectReport connect(const cloud::Cloud& cloud, NeighbourTable& table) {
  ConnectReport report;
  if (table.size() == 0) return report;
  OrientedDisjointSets pieces(table.size());
  report.pieces = table.size();
  for (std::uint32_t i = 0; i < table.size(); ++i)
    for (const std::uint32_t other : table.of[i])
      if (pieces.join(i, other) == OrientedDisjointSets::Joined::kNow) --report.pieces;
  Growth growth(cloud, table);
  report.unreached = growth.unreached();
  if (report.unreached > 0) growth.go_on(shortest_component_links(cloud, pieces, report.pieces), report);
  return report;
}

NeighbourTable connected_knn(const cloud::Cloud& cloud, int threads, ConnectReport* report) {
  NeighbourTable table = exact_knn(cloud, threads);
  const ConnectReport found = connect(cloud, table);
  if (report != nullptr) *report = found;
  return table;
}

CutOffReport cut_off_by_density(const cloud::Cloud& cloud, NeighbourTable& table, double factor,
                                int threads) {
  const std::size_t n = table.size();
  std::vector<double> fourth(n), limit(n);
  parallel_each(n, kPointsPerChunk, threads,
                [&](std::size_t i) { fourth[i] = fourth_mm(cloud, table, static_cast<std::uint32_t>(i)); });
  parallel_each(n, kPointsPerChunk, threads, [&](std::size_t i) {
    limit[i] = factor * local_spacing_mm(table, fourth, static_cast<std::uint32_t>(i));
  });
  const auto cut = [&](std::size_t i, CutOffReport& part) {
    const auto self = static_cast<std::uint32_t>(i);
    Neighbours& row = table.of[i];
    std::size_t kept = 0, had = 0;
    for (const std::uint32_t other : row) {
      if (other == self) continue;
      ++had;
      if ((cloud.local_mm(other) - cloud.local_mm(i)).norm() <= limit[i]) row[kept++] = other;
    }
    std::fill(row.begin() + static_cast<std::ptrdiff_t>(kept), row.end(), self);
    part.links_cut += had - kept;
    part.points_cut += kept < had;
    part.points_without += kept == 0 && had > 0;
  };
  CutOffReport sum;
  for (const auto& part : parallel_parts<CutOffReport>(n, kPointsPerChunk, threads, cut)) {
    sum.links_cut += part.links_cut;
    sum.points_cut += part.points_cut;
    sum.points_without += part.points_without;
  }
  return sum;
}

}  // namespace palpate::search
