#include "toolkit/spline_sdf/orient_patches.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <span>
#include <utility>

#include <Eigen/Geometry>
#include "toolkit/core/disjoint_sets.h"
#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"

namespace palpate::spline_sdf {

namespace {

/// Continuing patches: their chord leaves either tangent plane by at most this sine (50 degrees), and one
/// normal is the other's mirror image on it, as on an arc, within 50 degrees. Stacked sheets fail one of the
/// two.
constexpr double kSteepest = 0.77;
constexpr double kMinAgreement = 0.64;
/// Meeting patches come within this many spacings or standard deviations of each other, and of their ends.
constexpr double kOffSpacings = 0.4, kOffSigmas = 3.0, kBeyondEnd = 1.2;
constexpr int kMeetRounds = 3;
/// A point is on a patch within this many spacings or standard deviations, and tells of a meeting place
/// within kBeyondEnd of it.
constexpr double kOnEdgeSpacings = 0.2;
/// Weights of links that may be wrong: between patches that meet beyond their points, and between stacked
/// sheets, which are many times as many. Measured on seven shapes: with 0 and 1 up to 85 of 2,400 patches are
/// turned; from 0.1 to 0.3 and from 0.03 to 0.1 at most 3, but on walls under two spacings in noise.
constexpr double kWeightBeyond = 0.3, kWeightStacked = 0.1;
/// Links per patch, to the nearest.
constexpr std::size_t kMaxLinks = 24;
/// Classes of agreement; links are taken best first.
constexpr std::size_t kClasses = 64;
constexpr std::size_t kGrain = 512;
/// A piece of patches with fewer points, and less than this share of all, is an outlier: three of the
/// smallest patches.
constexpr double kOutlierPoints = 45.0, kOutlierShare = 0.05;
/// Meeting patches within 20 degrees form one face.
constexpr double kSmoothCosine = 0.94;
/// Rays start this many spacings or standard deviations above a patch, clear of its points.
constexpr double kWayBegins = 1.25, kWayBeginsSigmas = 4.0;
/// Balls grow by a quarter per step: this many reach 10^9 spacings.
constexpr int kMaxWaySteps = 96;
/// Rays at 45 degrees, besides the one along the normal.
constexpr int kSlantedWays = 6;
constexpr double kSlant = 1.0;
/// Approximate number of a face's patches that are tested. The side is decided if this share of all
/// directions differs; with few tests, if the difference exceeds chance (this over the square root of their
/// number).
constexpr std::uint32_t kAskedOfFace = 128;
constexpr double kClearlyOpen = 0.1, kByChance = 1.2;
/// Stacked sheets are parallel within 45 degrees, and no point lies between within this share of their
/// distance from the middle; a half would reach the sheets themselves.
constexpr double kFacing = 0.7, kBetween = 0.35;
constexpr std::size_t kAskGrain = 16;
/// Least support in spacings that is distinguished from smaller ones where the points are a part of all.
constexpr double kLeastOfPart = 1.0 / 256.0;

/// Farthest that patches of one surface are off each other, mm.
double most_off(const QuadricPatch& a, const QuadricPatch& b) {
  return std::max(kOffSpacings * std::min(a.spacing, b.spacing), kOffSigmas * std::min(a.sigma, b.sigma));
}

/// True if two patches that meet are of one face: alike, and each lies on the other. Patches of few points
/// lean, and meet those of a wall's other side; one such link would join the two sides.
bool continue_smoothly(const QuadricPatch& a, const QuadricPatch& b) {
  return std::abs(a.quadric.n.dot(b.quadric.n)) > kSmoothCosine &&
         std::max(std::abs(a.quadric.residual(b.quadric.at)), std::abs(b.quadric.residual(a.quadric.at))) <=
             most_off(a, b);
}

/// Finds where two patches meet by projecting to each in turn, from between them, nearer to the smaller.
/// Converges to their crease if there is one, at once on one surface. False if they stay apart or meet beyond
/// their ends.
bool meet(const QuadricPatch& a, const QuadricPatch& b, Vec3& at) {
  at = (b.support * a.quadric.at + a.support * b.quadric.at) / (a.support + b.support);
  double gap = 0.0;
  for (int i = 0; i < kMeetRounds; ++i) {
    at -= a.quadric.n * a.quadric.residual(at);
    gap = b.quadric.residual(at);
    at -= b.quadric.n * gap;
  }
  if (std::abs(gap) > most_off(a, b)) return false;
  const auto reaches = [&](const QuadricPatch& p) {
    const double reach = p.support + kBeyondEnd * p.spacing;
    return (at - p.quadric.at).squaredNorm() <= reach * reach;
  };
  return reaches(a) && reaches(b);
}

/// True if points of either patch alone are next to the place where they meet. Patches that reach beyond
/// their points meet those on the other side of a thin wall too.
bool have_points_at(const MortonPoints& points, const QuadricPatch& a, const QuadricPatch& b,
                    const Vec3& at) {
  const auto is_on = [](const QuadricPatch& p, const Vec3& place) {
    return std::abs(p.quadric.residual(place)) <=
           std::max(kOnEdgeSpacings * p.spacing, kOffSigmas * std::max(p.sigma, p.noise));
  };
  bool on_a = false, on_b = false;
  points.in_ball(at, kBeyondEnd * std::max(a.spacing, b.spacing),
                 [&](std::uint32_t, const Vec3& away, double) {
                   const bool is_on_a = is_on(a, at + away), is_on_b = is_on(b, at + away);
                   on_a = on_a || (is_on_a && !is_on_b);
                   on_b = on_b || (is_on_b && !is_on_a);
                 });
  return on_a && on_b;
}

/// Signed agreement of two patches' normals; 0 if they do not continue each other.
double agreement(const MortonPoints& points, const QuadricPatch& a, const QuadricPatch& b) {
  Vec3 at;
  if (!meet(a, b, at)) return 0.0;
  // From one centre to the other, over the meeting place.
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
  if (std::abs(agreed) < kMinAgreement) return 0.0;
  return continue_smoothly(a, b) || have_points_at(points, a, b, at) ? agreed : kWeightBeyond * agreed;
}

struct Link {
  std::uint32_t a, b;
  float agreed;
};

/// True if two patches that do not meet are stacked: sheets with a wall or gap and no third sheet between.
bool are_stacked(const MortonPoints& points, const QuadricPatch& a, const QuadricPatch& b) {
  if (std::abs(a.quadric.n.dot(b.quadric.n)) < kFacing) return false;
  const Vec3 d = b.quadric.at - a.quadric.at;
  const double h = d.dot(a.quadric.n), reach = std::max(a.support, b.support);
  return d.squaredNorm() - h * h < reach * reach &&
         !points.any_in_ball(a.quadric.at + a.quadric.n * (0.5 * h), kBetween * std::abs(h));
}

/// Links between continuing patches, and between stacked ones; the latter agree if one looks up and the other
/// down, so that what is between is on one side of both.
struct Links {
  std::vector<Link> on, across;
};

/// Cells decide which patches are compared: those of a part must be the same as in every other part.
PatchHashGrid grid_of(std::span<const QuadricPatch> patches, const MortonPoints* part) {
  return part == nullptr ? PatchHashGrid(patches)
                         : PatchHashGrid(patches, part->box_mm().low_mm - Vec3::Constant(part->spacing_mm()),
                                         kLeastOfPart * part->spacing_mm());
}

/// `part`: the points are a part of all.
Links find_links(const MortonPoints& points, std::span<const QuadricPatch> patches, bool part, int threads) {
  if (patches.empty()) return {};
  const PatchHashGrid cells = grid_of(patches, part ? &points : nullptr);
  const auto visit = [&](std::size_t begin, std::size_t end, Links& found) {
    std::vector<std::pair<double, Link>> mine;
    for (std::size_t i = begin; i < end; ++i) {
      const QuadricPatch& a = patches[i];
      mine.clear();
      const int own = cells.scale_of(a.support);
      for (int s = own; s < kPatchScales; ++s) {
        if (!cells.any(s)) continue;
        cells.near(a.quadric.at, s, [&](std::uint32_t j) {
          if (j == i || (s == own && j < i)) return;
          const QuadricPatch& b = patches[j];
          const double reach = kPatchReach * (a.support + b.support);
          const double sq = (b.quadric.at - a.quadric.at).squaredNorm();
          if (sq > reach * reach) return;
          const double agreed = agreement(points, a, b);
          if (agreed == 0.0) {
            if (are_stacked(points, a, b))
              found.across.push_back({static_cast<std::uint32_t>(i), j,
                                      static_cast<float>(-kWeightStacked * a.quadric.n.dot(b.quadric.n))});
            return;
          }
          mine.push_back(
              {sq / (reach * reach), {static_cast<std::uint32_t>(i), j, static_cast<float>(agreed)}});
        });
      }
      if (mine.size() > kMaxLinks) {
        std::sort(mine.begin(), mine.end(), [](const auto& x, const auto& y) {
          return x.first != y.first ? x.first < y.first : x.second.b < y.second.b;
        });
        mine.resize(kMaxLinks);
      }
      for (const auto& m : mine) found.on.push_back(m.second);
    }
  };
  std::vector<Links> parts = parallel_parts<Links>(patches.size(), kGrain, threads, visit);
  Links links;
  std::size_t on = 0, across = 0;
  for (const Links& found : parts) on += found.on.size(), across += found.across.size();
  links.on.reserve(on + across);  // orient_outwards() joins both
  links.across.reserve(across);
  for (Links& found : parts) {
    links.on.insert(links.on.end(), found.on.begin(), found.on.end());
    links.across.insert(links.across.end(), found.across.begin(), found.across.end());
    release_memory(found.on);
    release_memory(found.across);
  }
  return links;
}

/// Link indices by class of agreement, best first.
std::vector<std::uint32_t> order_by_agreement(std::span<const Link> links) {
  const auto class_of = [](const Link& link) {
    const double share = (1.0 - std::abs(static_cast<double>(link.agreed))) / (1.0 - kMinAgreement);
    return std::min(static_cast<std::size_t>(std::max(share, 0.0) * kClasses), kClasses - 1);
  };
  std::array<std::uint32_t, kClasses + 1> begin{};
  for (const Link& link : links) ++begin[class_of(link) + 1];
  for (std::size_t c = 0; c < kClasses; ++c) begin[c + 1] += begin[c];
  std::vector<std::uint32_t> order(links.size());
  for (std::uint32_t i = 0; i < links.size(); ++i) order[begin[class_of(links[i])]++] = i;
  return order;
}

/// True if balls growing along the ray meet no points.
bool ray_escapes(const MortonPoints& points, const MortonPoints* far, const Vec3& from, const Vec3& way,
                 double spacing) {
  const double least = kWayRadius * spacing;
  Vec3 at = from;
  double gone = 0.0;
  for (int step = 0; step < kMaxWaySteps; ++step) {
    if (points.box_mm().distance_sq_mm2(at) > least * least) return true;
    const double radius = std::max(least, kWayWidens * gone);
    const bool sampled = far != nullptr && gone >= kFarReach * far->spacing_mm();
    if ((sampled ? *far : points).any_in_ball(at, radius)) return false;
    gone += radius;
    at += way * radius;
  }
  return true;
}

/// From -1 to 1: the share of directions that escape above a patch minus that below.
double visibility_difference(const MortonPoints& points, const MortonPoints* far, const QuadricPatch& patch) {
  const Quadric& q = patch.quadric;
  const double off =
      std::max(kWayBegins * patch.spacing, kWayBeginsSigmas * std::max(patch.sigma, patch.noise));
  int above = 0, below = 0;
  const auto ask = [&](const Vec3& way) {
    above += ray_escapes(points, far, q.at + q.n * off, way, patch.spacing) ? 1 : 0;
    below +=
        ray_escapes(points, far, q.at - q.n * off, way - 2.0 * way.dot(q.n) * q.n, patch.spacing) ? 1 : 0;
  };
  ask(q.n);
  for (int k = 0; k < kSlantedWays; ++k) {
    const double turn = 2.0 * std::numbers::pi * k / kSlantedWays;
    ask((q.n + kSlant * (std::cos(turn) * q.u + std::sin(turn) * q.v)).normalized());
  }
  return static_cast<double>(above - below) / (1 + kSlantedWays);
}

/// Orients whole faces by visibility.
void orient_by_visibility(const MortonPoints& points, const MortonPoints* far,
                          std::span<const QuadricPatch> patches, std::uint32_t outside,
                          OrientedDisjointSets& sides, int threads) {
  // Samples patches of each face at a stride.
  std::vector<std::uint32_t> count(patches.size(), 0), seen(patches.size(), 0), asked;
  for (std::uint32_t i = 0; i < patches.size(); ++i) ++count[sides.find(i).set];
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    const std::uint32_t face = sides.find(i).set;
    if (seen[face]++ % (1 + count[face] / kAskedOfFace) == 0) asked.push_back(i);
  }
  std::vector<double> open(asked.size(), 0.0);
  parallel_each(asked.size(), kAskGrain, threads,
                [&](std::size_t k) { open[k] = visibility_difference(points, far, patches[asked[k]]); });
  std::vector<double> sum(patches.size(), 0.0), weights(patches.size(), 0.0), ways(patches.size(), 0.0);
  for (std::size_t k = 0; k < asked.size(); ++k) {
    const auto [face, flipped] = sides.find(asked[k]);
    const double area = patches[asked[k]].support * patches[asked[k]].support;
    sum[face] += (flipped != 0 ? -area : area) * open[k];
    weights[face] += area;
    ways[face] += 1 + kSlantedWays;
  }
  for (std::uint32_t i = 0; i < patches.size(); ++i)
    if (weights[i] > 0.0 &&
        std::abs(sum[i]) > std::max(kClearlyOpen, kByChance / std::sqrt(ways[i])) * weights[i])
      sides.join(outside, i, sum[i] < 0.0 ? 1 : 0);
}

/// Joins faces, and their pieces, by the sum of all links between them, best supported first: a single link
/// may be wrong, and the two sides of a thin wall have few others.
void join_faces(std::span<const Link> links, OrientedDisjointSets& sides, OrientedDisjointSets& pieces) {
  struct Vote {
    double sum = 0.0;
    std::uint32_t a = 0, b = 0;  ///< a patch of either face
  };
  std::map<std::pair<std::uint32_t, std::uint32_t>, Vote> votes;
  for (const Link& link : links) {
    const auto [a, flipped_a] = sides.find(link.a);
    const auto [b, flipped_b] = sides.find(link.b);
    if (a == b) continue;
    Vote& vote = votes[std::minmax(a, b)];
    vote.sum += static_cast<double>(flipped_a != flipped_b ? -link.agreed : link.agreed);
    vote.a = link.a;
    vote.b = link.b;
  }
  std::vector<std::pair<std::pair<std::uint32_t, std::uint32_t>, Vote>> order(votes.begin(), votes.end());
  std::stable_sort(order.begin(), order.end(), [](const auto& x, const auto& y) {
    return std::abs(x.second.sum) > std::abs(y.second.sum);
  });
  for (const auto& [roots, vote] : order) {
    if (sides.find(roots.first).set == sides.find(roots.second).set) continue;
    sides.join(roots.first, roots.second, vote.sum < 0.0 ? 1 : 0);
    pieces.join(vote.a, vote.b);
  }
}

void turn(Quadric& q) {
  // u and v stay, so QuadricPatch::occupancy stays valid.
  q.n = -q.n;
  q.uu = -q.uu;
  q.uv = -q.uv;
  q.vv = -q.vv;
}

/// Drops the patches of pieces too small to be surface, and of pieces without a reliable patch.
void drop_small_pieces(std::vector<QuadricPatch>& patches, OrientedPieces& of) {
  std::vector<std::uint32_t>& piece = of.piece;
  const bool any_sure =
      std::any_of(patches.begin(), patches.end(), [](const QuadricPatch& p) { return p.reliable; });
  std::vector<double> points(patches.size(), 0.0);
  double all = 0.0;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    if (any_sure && !patches[i].reliable) continue;
    points[piece[i]] += patches[i].points;
    all += patches[i].points;
  }
  const double least = std::min(kOutlierPoints, kOutlierShare * all);
  std::vector<std::uint32_t> now(patches.size());
  std::uint32_t kept = 0;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    if (points[piece[i]] < least) continue;
    now[i] = kept;  // a piece's number is its first patch
    patches[kept] = patches[i];
    of.group[kept] = of.group[i];
    piece[kept++] = now[piece[i]];
  }
  patches.resize(kept);
  piece.resize(kept);
  of.group.resize(kept);
}

}  // namespace

OrientedPieces orient_outwards(const MortonPoints& points, std::vector<QuadricPatch>& patches, int threads,
                               const MortonPoints* far) {
  auto [links, across] = find_links(points, patches, far != nullptr, threads);
  const auto outside = static_cast<std::uint32_t>(patches.size());  // one virtual node beyond the patches
  OrientedDisjointSets pieces(patches.size()), sides(patches.size() + 1);
  for (const Link& link : links) pieces.join(link.a, link.b);
  for (const std::uint32_t i : order_by_agreement(links))
    if (continue_smoothly(patches[links[i].a], patches[links[i].b]))
      sides.join(links[i].a, links[i].b, links[i].agreed < 0.0f ? 1 : 0);
  orient_by_visibility(points, far, patches, outside, sides, threads);
  links.insert(links.end(), across.begin(), across.end());
  join_faces(links, sides, pieces);
  // Pieces joined to the outside are oriented relative to it.
  const bool upside_down = sides.find(outside).flipped != 0;
  const std::uint32_t with_outside = sides.find(outside).set;
  std::vector<Vec3> areas(far != nullptr ? patches.size() + 1 : 0, Vec3::Zero());
  for (std::uint32_t i = 0; i < patches.size() && far != nullptr; ++i) {
    const auto [root, flipped] = sides.find(i);
    areas[root] +=
        (flipped != 0 ? -1.0 : 1.0) * patches[i].support * patches[i].support * patches[i].quadric.n;
  }
  const auto is_root_down = [&](std::uint32_t root) {
    return root == with_outside ? upside_down : far != nullptr && looks_down(areas[root]);
  };
  OrientedPieces out;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    const auto [root, flipped] = sides.find(i);
    out.piece.push_back(pieces.find(i).set);
    out.group.push_back(root == with_outside ? OrientedPieces::kOutward : root);
    if ((flipped != 0) != is_root_down(root)) turn(patches[i].quadric);
  }
  drop_small_pieces(patches, out);
  return out;
}

namespace {

/// A patch is off another if farther than this many standard deviations or spacings, and unrelated beyond the
/// largest distance.
constexpr double kBesideSigmas = 3.5, kBesideSpacings = 0.5, kBesideMost = 12.0;
/// A patch of points sparser than the other's by this factor is the same surface seen widely from an outlying
/// point.
constexpr double kMuchSparser = 2.0;
constexpr std::size_t kBesideGrain = 256;

bool is_outlier_beside(const QuadricPatch& p, const QuadricPatch& reliable) {
  const Quadric& q = reliable.quadric;
  const double off = std::abs(q.residual(p.quadric.at));
  if (off > kBesideMost * reliable.spacing) return false;
  if (p.spacing < kMuchSparser * reliable.spacing &&
      off < std::max(kBesideSigmas * std::max(reliable.sigma, reliable.noise),
                     kBesideSpacings * reliable.spacing))
    return false;
  const Vec3 d = p.quadric.at - q.at;
  const double per = 1.0 / reliable.extent;
  return reliable.occupancy.around(d.dot(q.u) * per, d.dot(q.v) * per);
}

}  // namespace

void drop_outlier_patches(std::vector<QuadricPatch>& patches, int threads, const MortonPoints* part) {
  if (std::all_of(patches.begin(), patches.end(), [](const QuadricPatch& p) { return p.reliable; })) return;
  const PatchHashGrid cells = grid_of(patches, part);
  std::vector<std::uint8_t> beside(patches.size(), 0);
  parallel_each(patches.size(), kBesideGrain, threads, [&](std::size_t i) {
    const QuadricPatch& p = patches[i];
    if (p.reliable) return;
    for (int s = cells.scale_of(p.support); s < kPatchScales && beside[i] == 0; ++s) {
      if (!cells.any(s)) continue;
      cells.near(p.quadric.at, s, [&](std::uint32_t j) {
        if (beside[i] == 0 && patches[j].reliable && is_outlier_beside(p, patches[j])) beside[i] = 1;
      });
    }
  });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < patches.size(); ++i)
    if (beside[i] == 0) patches[kept++] = patches[i];
  patches.resize(kept);
}

}  // namespace palpate::spline_sdf
