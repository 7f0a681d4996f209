#include "toolkit/smooth/patch_sides.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/patch_cells.h"

namespace palpate::render {
namespace {

/// The chord of two that do leaves either tangent plane by at most so much (sine of 50 degrees), and one
/// normal is the other mirrored on it, as on an arc, within 50 degrees. Sheets that lie above each other fail
/// either the one or the other.
constexpr double kSteepest = 0.77;
constexpr double kLeastAgreement = 0.64;
/// Two that meet come within so many spacings, or standard deviations, of each other, and within so many
/// spacings of where either ends.
constexpr double kOffSpacings = 0.4, kOffSigmas = 3.0, kBeyondEnd = 1.2;
constexpr int kMeetRounds = 3;
/// Links of one patch: to the nearest that there are.
constexpr std::size_t kMostLinks = 24;
/// Classes of agreement that links are taken in, best first.
constexpr std::size_t kClasses = 64;
constexpr std::size_t kGrain = 512;
/// A piece of patches that follow fewer points altogether, and less than this share of all, is of stray ones:
/// three of the smallest patches.
constexpr double kStrayPoints = 45.0, kStrayShare = 0.05;
/// Patches whose normals differ by less than this (20 degrees) and that meet are one face.
constexpr double kSmoothCosine = 0.94;
/// Ways off a patch begin so many spacings, or standard deviations, above it: clear of its own points. Balls
/// of this radius, in spacings, along one meet nearly every sheet (of points at random 92 of 100), and grow
/// by this share of the way.
constexpr double kWayBegins = 1.25, kWayBeginsSigmas = 4.0, kWayRadius = 0.9, kWayWidens = 0.25;
/// The balls grow by a quarter a step: so many reach 10^9 spacings.
constexpr int kMostWaySteps = 96;
/// Ways at 45 degrees, besides the one along the normal.
constexpr int kSlantedWays = 6;
constexpr double kSlant = 1.0;
/// Patches of a face that are asked, about. The side is told where this share of all directions differs, and
/// where few were asked more than chance makes of them: so much over the root of their number.
constexpr std::uint32_t kAskedOfFace = 128;
constexpr double kClearlyOpen = 0.1, kByChance = 1.2;
/// Sheets above each other are parallel to 45 degrees.
constexpr double kFacing = 0.7;
constexpr std::size_t kAskGrain = 16;

/// Where two patches meet, looked for from between them, farther from the larger one: by going to the one and
/// to the other in turn, which ends at their crease where they have one, and at once where they are one
/// surface. False where they stay apart, or meet beyond where they end.
bool meet(const Patch& a, const Patch& b, Vec3& at) {
  at = (b.support * a.quadric.at + a.support * b.quadric.at) / (a.support + b.support);
  double gap = 0.0;
  for (int i = 0; i < kMeetRounds; ++i) {
    at -= a.quadric.n * a.quadric.residual(at);
    gap = b.quadric.residual(at);
    at -= b.quadric.n * gap;
  }
  if (std::abs(gap) >
      std::max(kOffSpacings * std::min(a.spacing, b.spacing), kOffSigmas * std::min(a.sigma, b.sigma)))
    return false;
  const auto reaches = [&](const Patch& p) {
    const double reach = p.support + kBeyondEnd * p.spacing;
    return (at - p.quadric.at).squaredNorm() <= reach * reach;
  };
  return reaches(a) && reaches(b);
}

/// Agreement of two patches' normals, with its sign; 0 where they do not continue each other.
double agreement(const Patch& a, const Patch& b) {
  Vec3 at;
  if (!meet(a, b, at)) return 0.0;
  // The way from the one centre to the other, over where they meet.
  const Vec3 to = at - a.quadric.at, on = b.quadric.at - at;
  const double first = to.norm(), second = on.norm();
  Vec3 way = b.quadric.at - a.quadric.at;
  if (first > 0.0 && second > 0.0) way = to / first + on / second;
  const double length = way.norm();
  if (!(length > 0.0)) return a.quadric.n.dot(b.quadric.n);
  const Vec3 e = way / length;
  const double na = a.quadric.n.dot(e), nb = b.quadric.n.dot(e);
  if (std::abs(na) > kSteepest || std::abs(nb) > kSteepest) return 0.0;
  const double agreed = a.quadric.n.dot(b.quadric.n) - 2.0 * na * nb;
  return std::abs(agreed) < kLeastAgreement ? 0.0 : agreed;
}

struct Link {
  std::uint32_t a, b;
  float agreed;
};

/// Whether two patches that do not meet lie above each other: sheets with a wall or a gap between them.
bool lie_stacked(const Patch& a, const Patch& b) {
  if (std::abs(a.quadric.n.dot(b.quadric.n)) < kFacing) return false;
  const Vec3 d = b.quadric.at - a.quadric.at;
  const double h = d.dot(a.quadric.n), reach = std::max(a.support, b.support);
  return d.squaredNorm() - h * h < reach * reach;
}

/// Links of patches that continue each other, and of those that lie above each other: these agree where one
/// looks up and the other down, so that what is between them is on one side of both.
struct Links {
  std::vector<Link> on, across;
};

Links find_links(std::span<const Patch> patches, int threads) {
  if (patches.empty()) return {};
  const PatchCells cells(patches);
  const std::size_t chunks = (patches.size() + kGrain - 1) / kGrain;
  std::vector<Links> found(chunks);
  parallel_chunks(patches.size(), kGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<std::pair<double, Link>> mine;
    for (std::size_t i = begin; i < end; ++i) {
      const Patch& a = patches[i];
      mine.clear();
      const int own = cells.scale_of(a.support);
      for (int s = own; s < kPatchScales; ++s) {
        if (!cells.any(s)) continue;
        cells.near(a.quadric.at, s, [&](std::uint32_t j) {
          if (j == i || (s == own && j < i)) return;
          const Patch& b = patches[j];
          const double reach = kPatchReach * (a.support + b.support);
          const double sq = (b.quadric.at - a.quadric.at).squaredNorm();
          if (sq > reach * reach) return;
          const double agreed = agreement(a, b);
          if (agreed == 0.0) {
            if (lie_stacked(a, b))
              found[begin / kGrain].across.push_back(
                  {static_cast<std::uint32_t>(i), j, static_cast<float>(-a.quadric.n.dot(b.quadric.n))});
            return;
          }
          mine.push_back(
              {sq / (reach * reach), {static_cast<std::uint32_t>(i), j, static_cast<float>(agreed)}});
        });
      }
      if (mine.size() > kMostLinks) {
        std::sort(mine.begin(), mine.end(), [](const auto& x, const auto& y) {
          return x.first != y.first ? x.first < y.first : x.second.b < y.second.b;
        });
        mine.resize(kMostLinks);
      }
      for (const auto& m : mine) found[begin / kGrain].on.push_back(m.second);
    }
  });
  Links links;
  for (const Links& f : found) {
    links.on.insert(links.on.end(), f.on.begin(), f.on.end());
    links.across.insert(links.across.end(), f.across.begin(), f.across.end());
  }
  return links;
}

/// A forest with a parity to the root: which patches are one, and which of them stand on their heads.
class Sides {
 public:
  explicit Sides(std::size_t count) : parent_(count), turned_(count, 0) {
    std::iota(parent_.begin(), parent_.end(), 0u);
  }
  std::pair<std::uint32_t, bool> root(std::uint32_t i) {
    std::uint32_t r = i;
    bool turned = false;
    while (parent_[r] != r) {
      turned ^= turned_[r] != 0;
      r = parent_[r];
    }
    for (bool left = turned; parent_[i] != i;) {
      const bool own = turned_[i] != 0;
      const std::uint32_t next = parent_[i];
      parent_[i] = r;
      turned_[i] = left ? 1 : 0;
      left ^= own;
      i = next;
    }
    return {r, turned};
  }
  void join(std::uint32_t a, std::uint32_t b, bool turned) {
    const auto [ra, ta] = root(a);
    const auto [rb, tb] = root(b);
    if (ra == rb) return;
    const std::uint32_t low = std::min(ra, rb), high = std::max(ra, rb);
    parent_[high] = low;
    turned_[high] = static_cast<std::uint8_t>(turned != (ta != tb));
  }

 private:
  std::vector<std::uint32_t> parent_;
  std::vector<std::uint8_t> turned_;
};

/// Numbers of the links, by classes of agreement, best first.
std::vector<std::uint32_t> best_first(std::span<const Link> links) {
  const auto class_of = [](const Link& link) {
    const double share = (1.0 - std::abs(static_cast<double>(link.agreed))) / (1.0 - kLeastAgreement);
    return std::min(static_cast<std::size_t>(std::max(share, 0.0) * kClasses), kClasses - 1);
  };
  std::array<std::uint32_t, kClasses + 1> begin{};
  for (const Link& link : links) ++begin[class_of(link) + 1];
  for (std::size_t c = 0; c < kClasses; ++c) begin[c + 1] += begin[c];
  std::vector<std::uint32_t> order(links.size());
  for (std::uint32_t i = 0; i < links.size(); ++i) order[begin[class_of(links[i])]++] = i;
  return order;
}

/// Whether a way leads off from all points: balls that grow along it meet none.
bool leads_away(const SmoothPoints& points, const Vec3& from, const Vec3& way, double spacing) {
  const double least = kWayRadius * spacing;
  Vec3 at = from;
  double gone = 0.0;
  for (int step = 0; step < kMostWaySteps; ++step) {
    if (points.box_mm().distance_sq_mm2(at) > least * least) return true;
    const double radius = std::max(least, kWayWidens * gone);
    if (points.any_in_ball(at, radius)) return false;
    gone += radius;
    at += way * radius;
  }
  return true;
}

/// From -1 to 1: the share of directions that lead away above a patch less that below it.
double openness(const SmoothPoints& points, const Patch& patch) {
  const Quadric& q = patch.quadric;
  const double off =
      std::max(kWayBegins * patch.spacing, kWayBeginsSigmas * std::max(patch.sigma, patch.noise));
  int above = 0, below = 0;
  const auto ask = [&](const Vec3& way) {
    above += leads_away(points, q.at + q.n * off, way, patch.spacing) ? 1 : 0;
    below += leads_away(points, q.at - q.n * off, way - 2.0 * way.dot(q.n) * q.n, patch.spacing) ? 1 : 0;
  };
  ask(q.n);
  for (int k = 0; k < kSlantedWays; ++k) {
    const double turn = 2.0 * std::numbers::pi * k / kSlantedWays;
    ask((q.n + kSlant * (std::cos(turn) * q.u + std::sin(turn) * q.v)).normalized());
  }
  return static_cast<double>(above - below) / (1 + kSlantedWays);
}

/// Turns whole faces by what is seen from them.
void turn_by_openness(const SmoothPoints& points, std::span<const Patch> patches, std::uint32_t outside,
                      Sides& sides, int threads) {
  // Of each face every so many patches are asked.
  std::vector<std::uint32_t> count(patches.size(), 0), seen(patches.size(), 0), asked;
  for (std::uint32_t i = 0; i < patches.size(); ++i) ++count[sides.root(i).first];
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    const std::uint32_t face = sides.root(i).first;
    if (seen[face]++ % (1 + count[face] / kAskedOfFace) == 0) asked.push_back(i);
  }
  std::vector<double> open(asked.size(), 0.0);
  parallel_chunks(asked.size(), kAskGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) open[k] = openness(points, patches[asked[k]]);
  });
  std::vector<double> sum(patches.size(), 0.0), weights(patches.size(), 0.0), ways(patches.size(), 0.0);
  for (std::size_t k = 0; k < asked.size(); ++k) {
    const auto [face, turned] = sides.root(asked[k]);
    const double area = patches[asked[k]].support * patches[asked[k]].support;
    sum[face] += (turned ? -area : area) * open[k];
    weights[face] += area;
    ways[face] += 1 + kSlantedWays;
  }
  for (std::uint32_t i = 0; i < patches.size(); ++i)
    if (weights[i] > 0.0 &&
        std::abs(sum[i]) > std::max(kClearlyOpen, kByChance / std::sqrt(ways[i])) * weights[i])
      sides.join(outside, i, sum[i] < 0.0);
}

/// Turns what is not turned yet as the sheets above and below it ask, those that most patches tell of first.
/// Such sheets are one piece: only together they tell what is inside.
void turn_stacked(std::span<const Link> across, Sides& sides, Sides& pieces) {
  struct Vote {
    double sum = 0.0;
    std::uint32_t a = 0, b = 0;  ///< patches of either
  };
  std::map<std::pair<std::uint32_t, std::uint32_t>, Vote> votes;
  for (const Link& link : across) {
    const auto [a, turned_a] = sides.root(link.a);
    const auto [b, turned_b] = sides.root(link.b);
    if (a == b) continue;
    Vote& vote = votes[std::minmax(a, b)];
    vote.sum += static_cast<double>(turned_a != turned_b ? -link.agreed : link.agreed);
    vote.a = link.a;
    vote.b = link.b;
  }
  std::vector<std::pair<std::pair<std::uint32_t, std::uint32_t>, Vote>> order(votes.begin(), votes.end());
  std::stable_sort(order.begin(), order.end(), [](const auto& x, const auto& y) {
    return std::abs(x.second.sum) > std::abs(y.second.sum);
  });
  for (const auto& [roots, vote] : order) {
    if (sides.root(roots.first).first == sides.root(roots.second).first) continue;
    sides.join(roots.first, roots.second, vote.sum < 0.0);
    pieces.join(vote.a, vote.b, false);
  }
}

void turn(Quadric& q) {
  // u and v stay: what is known along them (Patch::filled) stays true.
  q.n = -q.n;
  q.uu = -q.uu;
  q.uv = -q.uv;
  q.vv = -q.vv;
}

/// Leaves out the patches of pieces too small to be surface, and those of which no patch is beyond doubt.
void drop_strays(std::vector<Patch>& patches, std::vector<std::uint32_t>& piece) {
  const bool any_sure = std::any_of(patches.begin(), patches.end(), [](const Patch& p) { return p.sure; });
  std::vector<double> points(patches.size(), 0.0);
  double all = 0.0;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    if (any_sure && !patches[i].sure) continue;
    points[piece[i]] += patches[i].points;
    all += patches[i].points;
  }
  const double least = std::min(kStrayPoints, kStrayShare * all);
  std::vector<std::uint32_t> now(patches.size());
  std::uint32_t kept = 0;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    if (points[piece[i]] < least) continue;
    now[i] = kept;  // a piece's number is that of its first patch
    patches[kept] = patches[i];
    piece[kept++] = now[piece[i]];
  }
  patches.resize(kept);
  piece.resize(kept);
}

}  // namespace

std::vector<std::uint32_t> turn_outwards(const SmoothPoints& points, std::vector<Patch>& patches,
                                         int threads) {
  const auto [links, across] = find_links(patches, threads);
  const std::vector<std::uint32_t> order = best_first(links);
  const auto outside = static_cast<std::uint32_t>(patches.size());  // stands beside all patches
  Sides pieces(patches.size()), sides(patches.size() + 1);
  const auto is_smooth = [&](const Link& link) {
    return std::abs(patches[link.a].quadric.n.dot(patches[link.b].quadric.n)) > kSmoothCosine;
  };
  for (const Link& link : links) pieces.join(link.a, link.b, false);
  for (const std::uint32_t i : order)
    if (is_smooth(links[i])) sides.join(links[i].a, links[i].b, links[i].agreed < 0.0f);
  turn_by_openness(points, patches, outside, sides, threads);
  for (const std::uint32_t i : order) sides.join(links[i].a, links[i].b, links[i].agreed < 0.0f);
  turn_stacked(across, sides, pieces);
  // What was joined to the outside is turned relative to it.
  const bool upside_down = sides.root(outside).second;
  const std::uint32_t with_outside = sides.root(outside).first;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    const auto [root, turned] = sides.root(i);
    if (turned != (root == with_outside && upside_down)) turn(patches[i].quadric);
  }
  std::vector<std::uint32_t> piece(patches.size());
  for (std::uint32_t i = 0; i < patches.size(); ++i) piece[i] = pieces.root(i).first;
  drop_strays(patches, piece);
  return piece;
}

}  // namespace palpate::render
