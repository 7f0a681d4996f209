#include "toolkit/smooth/patch_links.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/first_ball.h"
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
/// Normals that differ by more than this where two patches meet (20 degrees), and by so many standard errors,
/// make a crease.
constexpr double kCreaseSine = 0.34, kCreaseErrors = 3.0;
/// What both tell of it has to be so: of the points around where they meet this share, and not fewer than so
/// many of each, lie within so many standard deviations or spacings of the folded surface.
constexpr double kExplained = 0.75, kOnFaceSigmas = 3.5, kOnFaceSpacings = 0.1;
constexpr int kFewestOfEach = 3;
/// Links of one patch: to the nearest that there are.
constexpr std::size_t kMostLinks = 24;
/// Classes of agreement that links are taken in, best first.
constexpr std::size_t kClasses = 64;
constexpr std::size_t kGrain = 512;
/// A piece of patches that follow fewer points altogether, and less than this share of all, is of stray ones:
/// three of the smallest patches.
constexpr double kStrayPoints = 45.0, kStrayShare = 0.05;
constexpr std::uint32_t kDropped = 0xffffffffu;

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
      std::max(kOffSpacings * std::min(a.spacing, b.spacing), kOffSigmas * std::max(a.sigma, b.sigma)))
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

/// Of two patches that continue each other with the same side up.
Turn turn_between(const SmoothPoints& points, const Patch& a, const Patch& b) {
  Vec3 at;
  if (!meet(a, b, at)) return Turn::kNone;
  const double sine = (normal_at(a.quadric, at) - normal_at(b.quadric, at)).norm();
  if (sine < std::max(kCreaseSine, kCreaseErrors * std::hypot(a.slope_error, b.slope_error)))
    return Turn::kNone;
  const double spacing = std::max(a.spacing, b.spacing);
  const double on =
      std::max(kOnFaceSigmas * std::max({a.sigma, b.sigma, a.noise, b.noise}), kOnFaceSpacings * spacing);
  int all = 0, of_a = 0, of_b = 0, ridge = 0, valley = 0;
  points.in_ball(at, kFirstRadius * spacing, [&](std::uint32_t, const Vec3& d, double) {
    const double ra = a.quadric.residual(at + d), rb = b.quadric.residual(at + d);
    ++all;
    of_a += std::abs(ra) <= on && std::abs(ra) < std::abs(rb);
    of_b += std::abs(rb) <= on && std::abs(rb) < std::abs(ra);
    ridge += std::abs(std::max(ra, rb)) <= on;
    valley += std::abs(std::min(ra, rb)) <= on;
  });
  if (std::min(of_a, of_b) < kFewestOfEach || std::max(ridge, valley) < kExplained * all)
    return Turn::kUnclear;
  return ridge > valley ? Turn::kRidge : valley > ridge ? Turn::kValley : Turn::kNone;
}

struct Link {
  std::uint32_t a, b;
  float agreed;
};

std::vector<Link> find_links(std::span<const Patch> patches, int threads) {
  if (patches.empty()) return {};
  const PatchCells cells(patches);
  const std::size_t chunks = (patches.size() + kGrain - 1) / kGrain;
  std::vector<std::vector<Link>> found(chunks);
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
          if (agreed == 0.0) return;
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
      for (const auto& m : mine) found[begin / kGrain].push_back(m.second);
    }
  });
  std::vector<Link> links;
  for (const std::vector<Link>& f : found) links.insert(links.end(), f.begin(), f.end());
  return links;
}

/// A forest with a parity to the root: which patches are one sheet, and which of them stand on their heads.
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

void orient(std::vector<Patch>& patches, std::vector<Link>& links, Sides& sides) {
  const auto class_of = [](const Link& link) {
    const double share = (1.0 - std::abs(static_cast<double>(link.agreed))) / (1.0 - kLeastAgreement);
    return std::min(static_cast<std::size_t>(std::max(share, 0.0) * kClasses), kClasses - 1);
  };
  std::array<std::uint32_t, kClasses + 1> begin{};
  for (const Link& link : links) ++begin[class_of(link) + 1];
  for (std::size_t c = 0; c < kClasses; ++c) begin[c + 1] += begin[c];
  std::vector<std::uint32_t> order(links.size());
  for (std::uint32_t i = 0; i < links.size(); ++i) order[begin[class_of(links[i])]++] = i;
  for (const std::uint32_t i : order) sides.join(links[i].a, links[i].b, links[i].agreed < 0.0f);
  std::vector<std::uint8_t> turned(patches.size(), 0);
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    if (!sides.root(i).second) continue;
    turned[i] = 1;
    Quadric& q = patches[i].quadric;
    // u and v stay: what is known along them (Patch::filled) stays true.
    q.n = -q.n;
    q.uu = -q.uu;
    q.uv = -q.uv;
    q.vv = -q.vv;
  }
  // As agreement() would tell now.
  for (Link& link : links)
    if (turned[link.a] != turned[link.b]) link.agreed = -link.agreed;
}

/// Leaves out the patches of pieces too small to be surface, and their links.
void drop_strays(std::vector<Patch>& patches, std::vector<Link>& links, Sides& sides) {
  std::vector<double> points(patches.size(), 0.0);
  double all = 0.0;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    points[sides.root(i).first] += patches[i].points;
    all += patches[i].points;
  }
  const double least = std::min(kStrayPoints, kStrayShare * all);
  std::vector<std::uint32_t> now(patches.size());
  std::uint32_t kept = 0;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    const bool stays = points[sides.root(i).first] >= least;
    now[i] = stays ? kept++ : kDropped;
    if (stays) patches[now[i]] = patches[i];
  }
  if (kept == patches.size()) return;
  patches.resize(kept);
  std::erase_if(links, [&](const Link& link) { return now[link.a] == kDropped; });
  for (Link& link : links) link = {now[link.a], now[link.b], link.agreed};
  sides = Sides(kept);
  for (const Link& link : links) sides.join(link.a, link.b, false);
}

}  // namespace

PatchLinks link_patches(const SmoothPoints& points, std::vector<Patch>& patches, int threads,
                        const SmoothWithout& without) {
  std::vector<Link> links = find_links(patches, threads);
  Sides sides(patches.size());
  orient(patches, links, sides);
  if (!without.strays) drop_strays(patches, links, sides);
  PatchLinks out;
  out.sheet.resize(patches.size());
  for (std::uint32_t i = 0; i < patches.size(); ++i) out.sheet[i] = sides.root(i).first;
  // Against the sheet's sides: a seam, or two sheets after all.
  std::vector<Turn> turn(links.size());
  std::vector<std::uint8_t> stands(links.size());
  parallel_chunks(links.size(), kGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Patch &a = patches[links[i].a], &b = patches[links[i].b];
      stands[i] = links[i].agreed > 0.0f;
      if (stands[i] != 0 && !without.creases && a.sure && b.sure) turn[i] = turn_between(points, a, b);
      if (turn[i] == Turn::kUnclear) stands[i] = 0;
    }
  });
  out.begin.assign(patches.size() + 1, 0);
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (stands[i] == 0) continue;
    ++out.begin[links[i].a + 1];
    ++out.begin[links[i].b + 1];
  }
  for (std::size_t i = 0; i < patches.size(); ++i) out.begin[i + 1] += out.begin[i];
  out.creased.assign(patches.size(), 0);
  std::vector<std::uint32_t> next(out.begin.begin(), out.begin.end() - 1);
  out.to.resize(out.begin.back());
  out.turn.resize(out.begin.back());
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (stands[i] == 0) continue;
    const auto put = [&](std::uint32_t from, std::uint32_t to) {
      out.turn[next[from]] = turn[i];
      out.to[next[from]++] = to;
    };
    put(links[i].a, links[i].b);
    put(links[i].b, links[i].a);
    if (turn[i] != Turn::kNone) out.creased[links[i].a] = out.creased[links[i].b] = 1;
  }
  return out;
}

}  // namespace palpate::render
