// Thin, sharp, open, touching and nested bodies.

#include "experiments/stress/setups.h"
#include "experiments/stress/shapes.h"

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

}  // namespace palpate::experiments
