#include "toolkit/local_delaunay/candidate_triangulation.h"

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "toolkit/core/parallel.h"

namespace palpate::local_delaunay {
namespace {

using Pair = std::array<std::uint32_t, 2>;
using Triple = std::array<std::uint32_t, 3>;

/// Two triangles at one edge whose other corners are less than 60 degrees apart lie nearly on each other; one
/// is false. cos 60 = 0.5.
constexpr double kFoldCosine = 0.5;
/// Loops in noise are twice as long.
constexpr std::size_t kMaxRoughLoop = 2 * kMaxLoop;
/// Folds left after this many rounds of removing points with several fans are crumpled throughout.
constexpr int kPruningRounds = 3;

/// Planes that differ by more than 60 degrees belong to two sheets.
constexpr float kOfTwoSheets = 0.5F;

/// The triangles at a point, stored as their opposite edges.
class Link {
 public:
  std::vector<Pair> edges;

  [[nodiscard]] int degree(std::uint32_t b) const noexcept {
    int n = 0;
    for (const Pair& e : edges) n += static_cast<int>(e[0] == b) + static_cast<int>(e[1] == b);
    return n;
  }
  /// The point opposite the edge to b; b must have one triangle.
  [[nodiscard]] std::uint32_t apex(std::uint32_t b) const noexcept {
    for (const Pair& e : edges) {
      if (e[0] == b) return e[1];
      if (e[1] == b) return e[0];
    }
    return kNoPoint;
  }
  /// The other end of the chain that ends at b.
  [[nodiscard]] std::uint32_t other_end(std::uint32_t b) const noexcept {
    std::uint32_t at = b, from = kNoPoint;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      std::uint32_t to = kNoPoint;
      for (const Pair& e : edges) {
        if (e[0] == at && e[1] != from) to = e[1];
        if (e[1] == at && e[0] != from) to = e[0];
      }
      if (to == kNoPoint) break;
      from = at;
      at = to;
    }
    return at;
  }
  /// True if the point's triangles stay a fan, or separate fans, with the edge added.
  [[nodiscard]] bool takes(std::uint32_t b, std::uint32_t c) const noexcept {
    const int at_b = degree(b), at_c = degree(c);
    if (at_b > 1 || at_c > 1) return false;
    if (!edges.empty() && chains() == 0) return false;  // closed already
    if (at_b == 1 && at_c == 1 && other_end(b) == c) {
      // Closing the fan needs at least three triangles and no other chain.
      return edges.size() >= 2 && chains() == 1;
    }
    // Each chain has one more ring point than triangles.
    const std::size_t ring = edges.size() + 1 + chains() + static_cast<std::size_t>(at_b == 0 && at_c == 0);
    return ring <= kMaxCorners;
  }
  /// All triangles except those of the largest chain (the first of equals).
  [[nodiscard]] std::vector<Pair> beside_largest() const {
    std::vector<Pair> left = edges, largest;
    std::vector<Pair> beside;
    while (!left.empty()) {
      std::vector<Pair> chain = {left.back()};
      left.pop_back();
      for (std::size_t k = 0; k < chain.size(); ++k)
        for (std::size_t j = left.size(); j-- > 0;) {
          const bool joined = left[j][0] == chain[k][0] || left[j][0] == chain[k][1] ||
                              left[j][1] == chain[k][0] || left[j][1] == chain[k][1];
          if (!joined) continue;
          chain.push_back(left[j]);
          left.erase(left.begin() + static_cast<std::ptrdiff_t>(j));
        }
      if (chain.size() > largest.size()) largest.swap(chain);
      beside.insert(beside.end(), chain.begin(), chain.end());
    }
    return beside;
  }
  [[nodiscard]] std::size_t chains() const noexcept {
    std::size_t ends = 0;
    for (const Pair& e : edges)
      for (const std::uint32_t b : e) ends += degree(b) == 1;
    return ends / 2;
  }
};

class HoleFiller {
 public:
  explicit HoleFiller(CandidateTriangulation& candidate) : candidate_(candidate), link_of_(candidate.size()) {
    candidate.doubtful.resize(candidate.size());
    struct Part {
      std::vector<std::uint32_t> doubtful;
      bool any_rough = false;
    };
    const auto visit = [&](std::size_t i, Part& part) {
      link_of_[i] = kNoPoint;
      part.any_rough = part.any_rough || candidate.rough[i] != 0;
      const bool doubtful = candidate.welded[i] == 0 && !candidate.star[i].closed_and_agreed();
      candidate.doubtful[i] = static_cast<std::uint8_t>(doubtful);
      if (doubtful) part.doubtful.push_back(static_cast<std::uint32_t>(i));
    };
    for (const auto& part :
         parallel_parts<Part>(candidate.size(), kPointsPerChunk, candidate.threads, visit)) {
      any_rough_ = any_rough_ || part.any_rough;
      for (const std::uint32_t i : part.doubtful) add_link(i);
    }
  }

  HoleFillReport run() {
    HoleFillReport report;
    report.voted = take_voted();
    report.filled = fill_hole_loops(true);
    report.filled += fill_hole_loops(false);
    for (int round = 0; round < kPruningRounds; ++round) {
      const std::vector<std::uint32_t> pinched = those_pinched();
      if (pinched.empty()) break;
      report.filled += fill_without_smaller_fans(pinched);
    }
    write_stars();
    return report;
  }
  /// Runs on agreed sectors only, without these points.
  std::size_t run_without(const std::vector<std::uint32_t>& points) {
    for (const std::uint32_t i : points) ensure_link(i);
    const std::size_t filled = refill_without(points);
    write_stars();
    return filled;
  }

 private:
  void add_link(std::uint32_t i) {
    const Star& star = candidate_.star[i];
    link_of_[i] = static_cast<std::uint32_t>(points_.size());
    points_.push_back(i);
    Link link;
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (star.is_agreed(k)) link.edges.push_back({star.ring[k], star.ring[star.next(k)]});
    links_.push_back(std::move(link));
  }
  void ensure_link(std::uint32_t i) {
    if (has_link(i)) return;
    add_link(i);
    candidate_.doubtful[i] = 1;
  }
  void write_stars() {
    for (std::size_t l = 0; l < links_.size(); ++l)
      candidate_.star.put(points_[l], star_of(points_[l], links_[l]));
  }
  /// Points with separate fans. Layers folded behind the surface hang on them, and no loop passes them.
  [[nodiscard]] std::vector<std::uint32_t> those_pinched() {
    std::vector<std::uint32_t> out;
    for (const std::uint32_t i : points_)
      if (link(i).chains() > 1) out.push_back(i);
    std::sort(out.begin(), out.end());
    return out;
  }
  void remove(const Triple& t) {
    for (std::size_t k = 0; k < 3; ++k) {
      ensure_link(t[k]);
      auto& there = link(t[k]).edges;
      const std::uint32_t b = t[(k + 1) % 3], c = t[(k + 2) % 3];
      there.erase(std::find_if(there.begin(), there.end(), [&](const Pair& x) {
        return (x[0] == b && x[1] == c) || (x[0] == c && x[1] == b);
      }));
    }
  }
  /// Keeps the largest fan of such points and fills the holes that remain.
  std::size_t fill_without_smaller_fans(const std::vector<std::uint32_t>& points) {
    for (const std::uint32_t i : points)
      for (const Pair& e : link(i).beside_largest()) remove({i, e[0], e[1]});
    return fill_hole_loops(true) + fill_hole_loops(false);
  }
  /// Removes these points' triangles and fills the holes: a surface that skips a point is better than a hole.
  std::size_t refill_without(const std::vector<std::uint32_t>& points) {
    for (const std::uint32_t i : points) {
      const std::vector<Pair> edges = link(i).edges;
      for (const Pair& e : edges) remove({i, e[0], e[1]});
    }
    return fill_hole_loops(true) + fill_hole_loops(false);
  }
  [[nodiscard]] bool has_link(std::uint32_t i) const noexcept { return link_of_[i] != kNoPoint; }
  Link& link(std::uint32_t i) noexcept { return links_[link_of_[i]]; }

  [[nodiscard]] double circle_sq(const Triple& t) const noexcept {
    const Vec3 a = candidate_.at(t[0]), b = candidate_.at(t[1]) - a, c = candidate_.at(t[2]) - a;
    const double area = 4.0 * b.cross(c).squaredNorm();
    return area > 0.0 ? b.squaredNorm() * c.squaredNorm() * (b - c).squaredNorm() / area : HUGE_VAL;
  }
  /// For triangles (a, b, c) and (a, b, d) on edge a b.
  [[nodiscard]] bool folds(std::uint32_t a, std::uint32_t b, std::uint32_t c,
                           std::uint32_t d) const noexcept {
    const Vec3 p = candidate_.at(a);
    const Vec3 e = (candidate_.at(b) - p).normalized();
    Vec3 pc = candidate_.at(c) - p, pd = candidate_.at(d) - p;
    pc -= e * e.dot(pc);
    pd -= e * e.dot(pd);
    return pc.dot(pd) > kFoldCosine * pc.norm() * pd.norm();
  }
  [[nodiscard]] bool folds(const Triple& t) noexcept {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
      if (link(a).degree(b) == 1 && folds(a, b, c, link(a).apex(b))) return true;
    }
    return false;
  }
  /// At a crossing of sheets, a triangle with points of both belongs to neither.
  [[nodiscard]] bool joins_crossing(const Triple& t) const noexcept {
    if ((candidate_.crossed[t[0]] & candidate_.crossed[t[1]] & candidate_.crossed[t[2]]) == 0) return false;
    for (std::size_t k = 0; k < 3; ++k)
      if (std::abs(candidate_.normal[t[k]].dot(candidate_.normal[t[(k + 1) % 3]])) < kOfTwoSheets)
        return true;
    return false;
  }
  bool add(const Triple& t, bool flat) {
    for (const std::uint32_t i : t)
      if (!has_link(i)) return false;
    for (std::size_t k = 0; k < 3; ++k)
      if (!link(t[k]).takes(t[(k + 1) % 3], t[(k + 2) % 3])) return false;
    if (flat && folds(t)) return false;
    if (joins_crossing(t)) return false;
    for (std::size_t k = 0; k < 3; ++k) link(t[k]).edges.push_back({t[(k + 1) % 3], t[(k + 2) % 3]});
    return true;
  }

  /// Takes triangles of two stars, then of one star, roundest first.
  std::size_t take_voted() {
    std::vector<Triple> seen;
    for (const std::uint32_t i : points_) {
      const Star& star = candidate_.star[i];
      for (std::uint32_t k = 0; k < star.size; ++k) {
        if (!star.has_sector(k) || star.is_agreed(k)) continue;
        Triple t = {i, star.ring[k], star.ring[star.next(k)]};
        std::sort(t.begin(), t.end());
        seen.push_back(t);
      }
    }
    std::sort(seen.begin(), seen.end());
    struct Voted {
      int votes;
      double circle_sq;
      Triple corners;
    };
    std::vector<Voted> voted;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      if (i > 0 && seen[i] == seen[i - 1])
        ++voted.back().votes;
      else
        voted.push_back({1, circle_sq(seen[i]), seen[i]});
    }
    std::sort(voted.begin(), voted.end(), [](const Voted& a, const Voted& b) {
      if (a.votes != b.votes) return a.votes > b.votes;
      return a.circle_sq != b.circle_sq ? a.circle_sq < b.circle_sq : a.corners < b.corners;
    });
    std::size_t taken = 0;
    for (const Voted& v : voted) taken += add(v.corners, true);
    return taken;
  }

  /// The loop of open edges around the hole that begins start -> first. Empty if it is too long or passes a
  /// point where fans meet. If it is too long for any noise, marks its points in `long_loop`, by link.
  std::vector<std::uint32_t> loop_from(std::uint32_t start, std::uint32_t first,
                                       std::vector<std::uint8_t>& long_loop) {
    std::vector<std::uint32_t> loop = {start};
    std::uint32_t from = start, at = first;
    std::size_t rough = candidate_.rough[start];
    while (at != start) {
      rough += candidate_.rough[at];
      // With half its points in noise it is a hole in noise.
      const std::size_t most = 2 * rough > loop.size() ? kMaxRoughLoop : kMaxLoop;
      if (loop.size() >= most) {
        if (!any_rough_)
          for (const std::uint32_t i : loop) long_loop[link_of_[i]] = 1;
        return {};
      }
      if (!has_link(at) || link(at).chains() != 1) return {};
      loop.push_back(at);
      const std::uint32_t next = link(at).other_end(from);
      from = at;
      at = next;
    }
    return loop;
  }
  std::size_t fill_hole_loops(bool flat) {
    std::size_t filled = 0;
    std::vector<std::uint8_t> long_loop(points_.size(), 0);
    for (std::size_t l = 0; l < points_.size(); ++l) {
      const std::uint32_t i = points_[l];
      if (long_loop[l] != 0 || link(i).edges.empty() || link(i).chains() != 1) continue;
      for (const Pair& e : link(i).edges)
        for (const std::uint32_t b : e)
          if (link(i).degree(b) == 1) {
            filled += fill(loop_from(i, b, long_loop), flat);
            goto next_point;  // its edges have changed
          }
    next_point:;
    }
    return filled;
  }
  [[nodiscard]] double reach_sq(std::uint32_t i) const noexcept {
    return kReachPerBall * kReachPerBall * ball_sq(candidate_, i);
  }
  /// Cuts ears off the loop, roundest first.
  std::size_t fill(std::vector<std::uint32_t> loop, bool flat) {
    std::size_t filled = 0;
    while (loop.size() >= 3) {
      struct Ear {
        double circle_sq;
        std::size_t at;
      };
      std::vector<Ear> ears;
      const std::size_t n = loop.size();
      for (std::size_t j = 0; j < n; ++j) {
        const Triple t = {loop[(j + n - 1) % n], loop[j], loop[(j + 1) % n]};
        const double r = circle_sq(t);
        if (r <= std::max({reach_sq(t[0]), reach_sq(t[1]), reach_sq(t[2])})) ears.push_back({r, j});
      }
      std::sort(ears.begin(), ears.end(), [](const Ear& a, const Ear& b) {
        return a.circle_sq != b.circle_sq ? a.circle_sq < b.circle_sq : a.at < b.at;
      });
      bool added = false;
      for (const Ear& ear : ears) {
        const Triple t = {loop[(ear.at + n - 1) % n], loop[ear.at], loop[(ear.at + 1) % n]};
        if (!add(t, flat)) continue;
        added = true;
        ++filled;
        if (n == 3) return filled;
        loop.erase(loop.begin() + static_cast<std::ptrdiff_t>(ear.at));
        break;
      }
      if (!added) break;
    }
    return filled;
  }

  /// The link's chains in order around the point's normal.
  [[nodiscard]] Star star_of(std::uint32_t i, const Link& link) const {
    Star star;
    if (link.edges.empty()) return star;
    const Vec3 p = candidate_.at(i), normal = candidate_.normal[i].cast<double>();
    const Vec3 e = normal.unitOrthogonal(), f = normal.cross(e);
    struct Chain {
      double angle;
      bool closed;
      std::vector<std::uint32_t> points;
    };
    std::vector<Chain> chains;
    std::vector<std::uint8_t> used(link.edges.size(), 0);
    for (std::size_t begin = 0; begin < link.edges.size(); ++begin) {
      if (used[begin] != 0) continue;
      // Starts at a chain's end, or anywhere if it is closed.
      std::uint32_t first = link.edges[begin][0];
      const std::uint32_t end = link.degree(first) == 1 ? first : link.other_end(first);
      const bool closed = link.degree(end) == 2;
      Chain chain{0.0, closed, {}};
      std::uint32_t at = closed ? first : end;
      for (bool more = true; more;) {
        chain.points.push_back(at);
        more = false;
        for (std::size_t k = 0; k < link.edges.size() && !more; ++k) {
          if (used[k] != 0 || (link.edges[k][0] != at && link.edges[k][1] != at)) continue;
          used[k] = 1;
          at = link.edges[k][0] == at ? link.edges[k][1] : link.edges[k][0];
          more = true;
        }
      }
      if (closed) chain.points.pop_back();
      Vec3 area = Vec3::Zero();
      for (std::size_t k = 0; k + 1 < chain.points.size(); ++k)
        area += (candidate_.at(chain.points[k]) - p).cross(candidate_.at(chain.points[k + 1]) - p);
      if (area.dot(normal) < 0.0) std::reverse(chain.points.begin(), chain.points.end());
      const Vec3 d = candidate_.at(chain.points.front()) - p;
      chain.angle = std::atan2(f.dot(d), e.dot(d));
      chains.push_back(std::move(chain));
    }
    std::sort(chains.begin(), chains.end(), [](const Chain& a, const Chain& b) {
      return a.angle != b.angle ? a.angle < b.angle : a.points.front() < b.points.front();
    });
    for (const Chain& chain : chains) {
      for (const std::uint32_t b : chain.points) star.ring[star.size++] = b;
      if (!chain.closed) star.open |= 1u << (star.size - 1);
    }
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (star.has_sector(k)) star.agreed |= 1u << k;
    return star;
  }

  CandidateTriangulation& candidate_;
  UninitializedVector<std::uint32_t> link_of_;
  std::vector<std::uint32_t> points_;
  std::vector<Link> links_;
  bool any_rough_ = false;
};

}  // namespace

HoleFillReport fill_holes(CandidateTriangulation& candidate) {
  return HoleFiller(candidate).run();
}

std::size_t refill_without(CandidateTriangulation& candidate, const std::vector<std::uint32_t>& points) {
  return HoleFiller(candidate).run_without(points);
}

}  // namespace palpate::local_delaunay
