// Thin, sharp, open, touching and nested bodies.
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "experiments/stress/setups.h"
#include "experiments/stress/shapes.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

void add_plates(CaseGroup& bodies) {
  struct Plate {
    const char *name, *generator;
    double thickness_mm;
    bool quick;
  };
  for (const Plate& p :
       {Plate{"plate-1mm", "slab:extent_mm=16:thickness_mm=1:spacing_mm=0.3", 1.0, true},
        {"plate-0.1mm", "slab:extent_mm=16:thickness_mm=0.1:spacing_mm=0.3", 0.1, false},
        {"plate-0.01mm", "slab:extent_mm=16:thickness_mm=0.01:spacing_mm=0.3", 0.01, false}}) {
    const double top = 0.5 * p.thickness_mm;
    bodies.add(
        p.name, "A closed plate of points 0.3 mm apart, pressed from above to 0.8 mm.",
        on(p.generator,
           dipping({.from = {-3.1, 2.2, top}, .to = {3.3, -1.7, top}, .deep_mm = 0.8, .felt_mm = 0.2})),
        p.quick);
  }
}

void add_sharp(CaseGroup& bodies) {
  bodies.quick("needle", "A needle of one degree, 20 mm long, from the side and on its tip.",
               on([] { return cone_points(0.35, 20.0, 0.1); }, "needle", along({10, 0.1, 5}, [](Way& way) {
                    // Across the middle and back, then to the tip.
                    way.to({4, 0.1, 5}, 80, Due::kFree).to({-0.3, 0.1, 5}, 100, Due::kAny);
                    way.to({4, 0.1, 5}, 100, Due::kAny).to({8, 0.1, 5}, 80, Due::kFree);
                    way.to({8, 0, 30}, 200, Due::kAny).to({0.02, 0.01, 28}, 100, Due::kAny);
                    way.to({0.02, 0.01, 17}, 220, Due::kAny).to({0.02, 0.01, 26}, 200, Due::kAny);
                    way.to({0.02, 0.01, 30}, 60, Due::kFree);
                  })));
  bodies.add("horn", "A bent horn that ends in a point.",
             on([] { return horn_points(12.0, 2.0, 0.25); }, "horn", along({20, 0, 0}, [](Way& way) {
                  way.to({17, 0, 0}, 60, Due::kFree).to({12, 0, 0.4}, 100, Due::kAny);
                  way.to({17, 0, 0}, 100, Due::kAny).to({17, 17, 0}, 200, Due::kAny);
                  way.to({0, 17, 0}, 200, Due::kAny).to({0.05, 11, 0.02}, 120, Due::kAny);
                  way.to({0, 17, 0}, 120, Due::kAny).to({0, 20, 0}, 60, Due::kFree);
                })));
  bodies.quick("cube", "A cube with sharp edges, around it 0.3 mm deep.",
               on("slab:extent_mm=10:thickness_mm=10:spacing_mm=0.4", along({1.3, 0.7, 12}, [](Way& way) {
                    way.to({1.3, 0.7, 8}, 50, Due::kFree).to({1.3, 0.7, 4.7}, 100, Due::kAny);
                    way.to({4.7, 0.9, 4.7}, 150, Due::kInside).to({4.7, 0.9, -4.7}, 200, Due::kInside);
                    way.to({4.7, 4.7, -4.7}, 150, Due::kInside).to({4.7, 4.7, 4.7}, 200, Due::kInside);
                    way.to({8, 8, 8}, 100, Due::kAny).to({9, 9, 9}, 20, Due::kFree);
                  })));
}

void add_open(CaseGroup& bodies) {
  constexpr const char* kVase = "bowl:extent_mm=50:rim_deg=140:points=12000";
  const Change into_vase = along({0.3, 0.2, 45}, [](Way& way) {
    way.to({0.3, 0.2, -15}, 300, Due::kFree).to({0.3, 0.2, -26}, 150, [](const Vec3& p) {
      return p.norm() > 25.3 ? Due::kInside : Due::kAny;
    });
    way.to({0.3, 0.2, -15}, 150, Due::kAny).to({15, 0.2, 0}, 150, Due::kFree);
    way.to({26, 0.2, 0}, 150, Due::kAny).to({15, 0.2, 0}, 150, Due::kAny);
    way.to({0.3, 0.2, 5}, 100, Due::kFree).to({0.3, 0.2, 45}, 200, Due::kFree);
  });
  bodies.add("vase", "A ball with a mouth, entered through it and pressed from within.",
             on(kVase, into_vase));
  bodies.add("vase-both-sides", "The same with the option that feels both of its sides.",
             on(kVase, [into_vase](StressSetup& setup) {
               into_vase(setup);
               setup.options.set("sides", "both");
             }));
  bodies.quick("rim-sideways", "An open sheet, left over its rim half a millimetre deep.",
               on(
                   [] {
                     return lattice_points({-10, -10, 0}, {0.4, 0, 0}, {0, 0.4, 0}, 51, 51);
                   },
                   "sheet", along({1, 0.3, 6}, [](Way& way) {
                     way.to({1, 0.3, 4}, 20, Due::kFree).to({1, 0.3, -0.5}, 90, Due::kAny);
                     way.to({9, 0.3, -0.5}, 160, Due::kInside).to({13.5, 0.3, -0.5}, 90, Due::kAny);
                     way.to({30, 0.3, -0.5}, 330, Due::kFree).to({30, 0.3, 6}, 130, Due::kFree);
                     way.to({1, 0.3, 6}, 300, Due::kFree);
                   })));
  bodies.quick("floor-and-wall", "A floor that meets a wall: into the corner and along it.",
               on(
                   [] {
                     return joined_points(lattice_points({-8, -8, 0}, {0.4, 0, 0}, {0, 0.4, 0}, 41, 41),
                                          lattice_points({8, -8, 0.4}, {0, 0.4, 0}, {0, 0, 0.4}, 41, 40));
                   },
                   "floor and wall", along({1, 0.3, 6}, [](Way& way) {
                     way.to({1, 0.3, 4}, 40, Due::kFree).to({1, 0.3, -0.5}, 90, Due::kAny);
                     way.to({8.5, 0.3, -0.5}, 150, Due::kInside).to({8.5, 5, -0.5}, 100, Due::kInside);
                     way.to({8.5, 5, 8}, 170, Due::kInside).to({4, 3, 8}, 90, Due::kAny);
                     way.to({1, 0.3, 8}, 60, Due::kFree);
                   })));
}

void add_nested(CaseGroup& bodies) {
  bodies.add(
      "touching-balls", "Two balls that touch in one point, into the neck.",
      on(
          [] {
            return joined_points(ball_points({-5, 0, 0}, 5.0, 3000), ball_points({5, 0, 0}, 5.0, 3000));
          },
          "touching balls", along({0, 0, 9}, [](Way& way) {
            way.to({0.03, 0.02, 7}, 50, Due::kFree).to({0.03, 0.02, -1}, 200, Due::kAny);
            way.to({0.03, 0.02, 7}, 200, Due::kAny).to({0, 0, 9}, 50, Due::kFree);
          })));
  bodies.quick("nested", "Three closed balls, one in the other, pressed to the middle.",
               on(
                   [] {
                     Points points;
                     for (const double radius : {10.0, 9.0, 5.0})
                       points = joined_points(std::move(points), ball_points(Vec3::Zero(), radius, 4000));
                     return points;
                   },
                   "nested balls", along({0, 0, 16}, [](Way& way) {
                     way.to({0.2, 0.1, 13}, 50, Due::kFree).to({0.2, 0.1, 9.6}, 80, Due::kAny);
                     way.to({0.2, 0.1, 9.5}, 10, Due::kInside).to({0.2, 0.1, 0.3}, 200, Due::kAny);
                     way.to({0.2, 0.1, 13}, 300, Due::kAny).to({0, 0, 16}, 50, Due::kFree);
                   })));
  bodies.add("shells", "A hollow ball whose wall is 0.2 mm thick.",
             on("shells:extent_mm=20:gap_mm=0.2:points=12000", along({0.2, 0.1, 16}, [](Way& way) {
                  way.to({0.2, 0.1, 13}, 50, Due::kFree).to({0.2, 0.1, 9.7}, 80, Due::kAny);
                  way.to({0.2, 0.1, 9}, 40, Due::kInside).to({0.2, 0.1, 13}, 80, Due::kAny);
                  way.to({0, 0, 16}, 50, Due::kFree);
                })));
}

}  // namespace

void add_body_cases(std::vector<StressCase>& cases) {
  CaseGroup bodies(cases, "bodies");
  add_plates(bodies);
  add_sharp(bodies);
  add_open(bodies);
  add_nested(bodies);
}

// Clouds of extreme spacings, and clouds that are hardly surfaces.

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
