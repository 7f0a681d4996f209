// Clouds of extreme spacings, and clouds that are hardly surfaces.
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "experiments/stress/setups.h"
#include "experiments/stress/shapes.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

/// Square rings around the origin in the plane z = 0, each with twice the spacing of the one inside it.
Points graded_plane(double finest_mm, int rings) {
  constexpr int kHalf = 8;  // half of a ring's outer edge, in its spacing
  Points points;
  double step = finest_mm;
  for (int ring = 0; ring < rings; ++ring, step *= 2.0)
    for (int j = -kHalf; j <= kHalf; ++j)
      for (int i = -kHalf; i <= kHalf; ++i)
        if (ring == 0 || std::max(std::abs(i), std::abs(j)) > kHalf / 2)
          points.emplace_back(i * step, j * step, 0.0);
  return points;
}

void add_spacings(CaseGroup& spacing) {
  struct Grade {
    const char* name;
    double finest_mm;
    int rings;
    bool quick;
  };
  for (const Grade& g : {Grade{"spacing-1:100", 0.1, 8, false}, {"spacing-1:10000", 1e-3, 15, true}}) {
    const double coarsest = g.finest_mm * std::exp2(g.rings - 1);
    const auto points = [g] { return graded_plane(g.finest_mm, g.rings); };
    Dip d{{0.1 * g.finest_mm, 0.2 * g.finest_mm, 0}, {3.3 * g.finest_mm, -2.1 * g.finest_mm, 0}};
    d.out_mm = 5 * coarsest;
    d.clear_mm = 4 * coarsest;
    d.deep_mm = 0.5;
    d.frames = 400;
    spacing.add(g.name, "A plane of squares with spacings doubled from ring to ring, felt in the middle.",
                on(points, "graded plane", dipping(d)), g.quick);
    d.from = {5.1 * coarsest, 0.3 * coarsest, 0};
    d.to = {-4.9 * coarsest, 0.9 * coarsest, 0};
    spacing.add(fmt::format("{}-across", g.name), "The same plane, from ring to ring across the middle.",
                on(points, "graded plane", dipping(d)));
  }
}

/// A plane with one distant outlier.
void add_strays(CaseGroup& spacing) {
  const auto beside = [](const Vec3& stray, const char* name) {
    return on([stray] { return joined_points(flat_lattice(20, 0.5), {stray}); }, name,
              dipping({.from = {-3.1, 1.2, 0}, .to = {3.3, 0.8, 0}, .out_mm = 6.0, .clear_mm = 5.0}));
  };
  spacing.quick("stray-100mm", "A plane and one stray point 100 mm above its border.",
                beside({40, 40, 80}, "a plane and a stray point"));
  spacing.quick("stray-1e6mm", "A plane and one stray point a kilometre off.",
                beside({1e6, 2e5, 3e5}, "a plane and a far point"));
}

/// Points by index: `count` of them.
template <class At>
Points points_at(int count, At at) {
  Points points;
  for (int i = 0; i < count; ++i) points.push_back(at(i));
  return points;
}

Points scattered_points(int count, double half_mm, std::uint64_t seed) {
  Random random(seed);
  const auto length = [&] { return random.uniform(-half_mm, half_mm); };
  return points_at(count, [&](int) { return Vec3{length(), length(), length()}; });
}

/// Crossed without an expected force: free above a clearance, and nothing else is asked.
struct Degenerate {
  const char *name, *text;
  bool quick;
  double out_mm, clear_mm;
  Points (*points)();
};
constexpr Degenerate kDegenerate[] = {
    {"one-point", "A cloud of one point.", true, 5.0, 4.0,
     [] {
       return Points(1, {0.05, 0.03, 0});
     }},
    {"two-points", "Two points.", true, 8.0, 6.0,
     [] { return points_at(2, [](int i) { return Vec3(0.5 * i, 0.4 * i, 0); }); }},
    {"two-points-ulp", "Two points one rounding unit apart.", false, 8.0, 6.0,
     [] {
       return points_at(3, [](int i) {
         return Vec3(i == 0 ? 1.0 : i == 1 ? std::nextafter(1.0, 2.0) : 0.0, 0, 0);
       });
     }},
    {"collinear", "A hundred points on a line.", true, 5.0, 4.0,
     [] { return points_at(100, [](int i) { return Vec3(0.1 * (i - 50), 0.05 * (i - 50), 0); }); }},
    {"collinear-steep", "A hundred points on a line that the probe follows.", false, 5.0, 4.0,
     [] { return points_at(100, [](int i) { return Vec3(0.05, 0.03, 0.02 * (i - 50)); }); }},
    {"duplicates-only", "A thousand points at one place.", true, 5.0, 4.0,
     [] {
       return Points(1000, {0.05, 0.03, 0});
     }},
    {"duplicates-two-places", "A thousand points at two places.", false, 8.0, 6.0,
     [] {
       return joined_points(Points(500, {0.05, 0.03, 0}), Points(500, {0.4, 0.3, 0}));
     }},
    {"every-point-thrice", "A plane whose every point is there three times.", true, 5.0, 4.0,
     [] {
       Points all;
       for (const Vec3& p : flat_lattice(20, 0.25)) all.insert(all.end(), 3, p);
       return all;
     }},
    {"coplanar-scattered", "Points scattered in a plane.", false, 9.0, 7.0,
     [] {
       Points points = scattered_points(2000, 5.0, 5);
       for (Vec3& p : points) p.z() = 0.0;
       return points;
     }},
    {"eight-points", "A cube's corners.", true, 12.0, 9.0,
     [] { return points_at(8, [](int i) { return Vec3(i & 1, i >> 1 & 1, -(i >> 2 & 1)); }); }},
    {"volume", "Points scattered in a volume: no surface at all.", false, 14.0, 11.0,
     [] { return scattered_points(3000, 5.0, 9); }},
    {"coincident-sheets", "Two thousand sheets at one place.", true, 5.0, 4.0,
     [] {
       Points points;
       for (int sheet = 0; sheet < 2000; ++sheet)
         points = joined_points(std::move(points), flat_lattice(3, 0.5));
       return points;
     }},
    {"sheets-ulp-apart", "A thousand sheets, each one rounding unit of single precision above the other.",
     false, 5.0, 4.0, [] {
       Points points;
       float z = 0.5f;
       for (int sheet = 0; sheet < 1000; ++sheet, z = std::nextafter(z, 1.0f))
         points = joined_points(std::move(points), flat_lattice(3, 0.5, static_cast<double>(z) - 0.5));
       return points;
     }}};

}  // namespace

void add_cloud_cases(std::vector<StressCase>& cases) {
  CaseGroup spacing(cases, "spacing"), degenerate(cases, "degenerate");
  add_spacings(spacing);
  add_strays(spacing);
  for (const Degenerate& one : kDegenerate)
    degenerate.add(one.name, one.text,
                   on(one.points, one.name,
                      dipping({.from = {0.05, 0.03, 0},
                               .to = Vec3(0.05, 0.03, 0) + Vec3(0.4, 0.3, 0),
                               .out_mm = one.out_mm,
                               .deep_mm = 0.5 * one.out_mm,
                               .clear_mm = one.clear_mm,
                               .felt_mm = std::numeric_limits<double>::infinity()})),
                   one.quick);
}

}  // namespace palpate::experiments
