// Thin, sharp, open, touching and nested bodies.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <palpate/result.h>
#include "experiments/stress/setups.h"
#include "experiments/stress/shapes.h"

namespace palpate::experiments {
namespace {

using Points = std::vector<Vec3>;

std::function<Result<StressSetup>()> body(std::function<Points()> points, const char* name,
                                          std::function<void(Way&)> go, Vec3 start) {
  return [=]() -> Result<StressSetup> {
    PALPATE_ASSIGN(StressSetup setup, setup_of_points(points(), name));
    Way way(start);
    go(way);
    std::move(way).put_into(setup);
    return setup;
  };
}

void add_plates(std::vector<StressCase>& cases) {
  struct Plate {
    const char *name, *generator;
    double thickness_mm;
    bool quick;
  };
  for (const Plate& p :
       {Plate{"plate-1mm", "slab:extent_mm=16:thickness_mm=1:spacing_mm=0.3", 1.0, true},
        {"plate-0.1mm", "slab:extent_mm=16:thickness_mm=0.1:spacing_mm=0.3", 0.1, false},
        {"plate-0.01mm", "slab:extent_mm=16:thickness_mm=0.01:spacing_mm=0.3", 0.01, false}}) {
    cases.push_back({p.name, "bodies", "A closed plate of points 0.3 mm apart, pressed from above to 0.8 mm.",
                     p.quick, false, [p]() -> Result<StressSetup> {
                       PALPATE_ASSIGN(StressSetup setup, setup_of_generator(p.generator));
                       const double top = 0.5 * p.thickness_mm;
                       Dip d{{-3.1, 2.2, top}, {3.3, -1.7, top}};
                       d.deep_mm = 0.8;
                       d.felt_mm = 0.2;
                       d.out_mm = 4.0;
                       dip(setup, d);
                       return setup;
                     }});
  }
}

void add_sharp(std::vector<StressCase>& cases) {
  const auto across = [](Way& way) {  // across the middle and back, then to the tip
    const Vec3 side(8, 0.1, 5);
    way.to({4, 0.1, 5}, 80, Due::kFree).to({-0.3, 0.1, 5}, 100, Due::kAny).to({4, 0.1, 5}, 100, Due::kAny);
    way.to(side, 80, Due::kFree).to({8, 0, 30}, 200, Due::kAny).to({0.02, 0.01, 28}, 100, Due::kAny);
    way.to({0.02, 0.01, 17}, 220, Due::kAny)
        .to({0.02, 0.01, 26}, 200, Due::kAny)
        .to({0.02, 0.01, 30}, 60, Due::kFree);
  };
  cases.push_back({"needle", "bodies", "A needle of one degree, 20 mm long, from the side and on its tip.",
                   true, false,
                   body([] { return cone_points(0.35, 20.0, 0.1); }, "needle", across, {10, 0.1, 5})});
  cases.push_back({"horn", "bodies", "A bent horn that ends in a point.", false, false,
                   body([] { return horn_points(12.0, 2.0, 0.25); }, "horn",
                        [](Way& way) {
                          way.to({17, 0, 0}, 60, Due::kFree)
                              .to({12, 0, 0.4}, 100, Due::kAny)
                              .to({17, 0, 0}, 100, Due::kAny);
                          way.to({17, 17, 0}, 200, Due::kAny).to({0, 17, 0}, 200, Due::kAny);
                          way.to({0.05, 11, 0.02}, 120, Due::kAny)
                              .to({0, 17, 0}, 120, Due::kAny)
                              .to({0, 20, 0}, 60, Due::kFree);
                        },
                        {20, 0, 0})});
  cases.push_back({"cube", "bodies", "A cube with sharp edges, around it 0.3 mm deep.", true, false,
                   []() -> Result<StressSetup> {
                     PALPATE_ASSIGN(StressSetup setup,
                                    setup_of_generator("slab:extent_mm=10:thickness_mm=10:spacing_mm=0.4"));
                     Way way({1.3, 0.7, 12});
                     way.to({1.3, 0.7, 8}, 50, Due::kFree).to({1.3, 0.7, 4.7}, 100, Due::kAny);
                     way.to({4.7, 0.9, 4.7}, 150, Due::kInside).to({4.7, 0.9, -4.7}, 200, Due::kInside);
                     way.to({4.7, 4.7, -4.7}, 150, Due::kInside).to({4.7, 4.7, 4.7}, 200, Due::kInside);
                     way.to({8, 8, 8}, 100, Due::kAny).to({9, 9, 9}, 20, Due::kFree);
                     std::move(way).put_into(setup);
                     return setup;
                   }});
}

void add_open(std::vector<StressCase>& cases) {
  const auto vase = []() -> Result<StressSetup> {
    PALPATE_ASSIGN(StressSetup setup, setup_of_generator("bowl:extent_mm=50:rim_deg=140:points=12000"));
    Way way({0.3, 0.2, 45});
    way.to({0.3, 0.2, -15}, 300, Due::kFree).to({0.3, 0.2, -26}, 150, [](const Vec3& p) {
      return p.norm() > 25.3 ? Due::kInside : Due::kAny;
    });
    way.to({0.3, 0.2, -15}, 150, Due::kAny).to({15, 0.2, 0}, 150, Due::kFree);
    way.to({26, 0.2, 0}, 150, Due::kAny).to({15, 0.2, 0}, 150, Due::kAny);
    way.to({0.3, 0.2, 5}, 100, Due::kFree).to({0.3, 0.2, 45}, 200, Due::kFree);
    std::move(way).put_into(setup);
    return setup;
  };
  cases.push_back({"vase", "bodies", "A ball with a mouth, entered through it and pressed from within.",
                   false, false, vase});
  cases.push_back({"vase-both-sides", "bodies", "The same with the option that feels both of its sides.",
                   false, false, [vase]() -> Result<StressSetup> {
                     PALPATE_ASSIGN(StressSetup setup, vase());
                     setup.options.set("sides", "both");
                     return setup;
                   }});
  const auto sheet = [] { return lattice_points({-10, -10, 0}, {0.4, 0, 0}, {0, 0.4, 0}, 51, 51); };
  cases.push_back({"rim-sideways", "bodies", "An open sheet, left over its rim half a millimetre deep.", true,
                   false,
                   body(sheet, "sheet",
                        [](Way& way) {
                          way.to({1, 0.3, 4}, 20, Due::kFree).to({1, 0.3, -0.5}, 90, Due::kAny);
                          way.to({9, 0.3, -0.5}, 160, Due::kInside).to({13.5, 0.3, -0.5}, 90, Due::kAny);
                          way.to({30, 0.3, -0.5}, 330, Due::kFree).to({30, 0.3, 6}, 130, Due::kFree);
                          way.to({1, 0.3, 6}, 300, Due::kFree);
                        },
                        {1, 0.3, 6})});
  cases.push_back({"floor-and-wall", "bodies", "A floor that meets a wall: into the corner and along it.",
                   true, false,
                   body(
                       [] {
                         Points points = lattice_points({-8, -8, 0}, {0.4, 0, 0}, {0, 0.4, 0}, 41, 41);
                         const Points wall = lattice_points({8, -8, 0.4}, {0, 0.4, 0}, {0, 0, 0.4}, 41, 40);
                         points.insert(points.end(), wall.begin(), wall.end());
                         return points;
                       },
                       "floor and wall",
                       [](Way& way) {
                         way.to({1, 0.3, 4}, 40, Due::kFree)
                             .to({1, 0.3, -0.5}, 90, Due::kAny)
                             .to({8.5, 0.3, -0.5}, 150, Due::kInside);
                         way.to({8.5, 5, -0.5}, 100, Due::kInside).to({8.5, 5, 8}, 170, Due::kInside);
                         way.to({4, 3, 8}, 90, Due::kAny).to({1, 0.3, 8}, 60, Due::kFree);
                       },
                       {1, 0.3, 6})});
}

void add_nested(std::vector<StressCase>& cases) {
  cases.push_back(
      {"touching-balls", "bodies", "Two balls that touch in one point, into the neck.", false, false,
       body(
           [] {
             Points points = ball_points({-5, 0, 0}, 5.0, 3000), other = ball_points({5, 0, 0}, 5.0, 3000);
             points.insert(points.end(), other.begin(), other.end());
             return points;
           },
           "touching balls",
           [](Way& way) {
             way.to({0.03, 0.02, 7}, 50, Due::kFree).to({0.03, 0.02, -1}, 200, Due::kAny);
             way.to({0.03, 0.02, 7}, 200, Due::kAny).to({0, 0, 9}, 50, Due::kFree);
           },
           {0, 0, 9})});
  cases.push_back({"nested", "bodies", "Three closed balls, one in the other, pressed to the middle.", true,
                   false,
                   body(
                       [] {
                         Points points;
                         for (const double radius : {10.0, 9.0, 5.0}) {
                           const Points one = ball_points(Vec3::Zero(), radius, 4000);
                           points.insert(points.end(), one.begin(), one.end());
                         }
                         return points;
                       },
                       "nested balls",
                       [](Way& way) {
                         way.to({0.2, 0.1, 13}, 50, Due::kFree).to({0.2, 0.1, 9.6}, 80, Due::kAny);
                         way.to({0.2, 0.1, 9.5}, 10, Due::kInside).to({0.2, 0.1, 0.3}, 200, Due::kAny);
                         way.to({0.2, 0.1, 13}, 300, Due::kAny).to({0, 0, 16}, 50, Due::kFree);
                       },
                       {0, 0, 16})});
  cases.push_back({"shells", "bodies", "A hollow ball whose wall is 0.2 mm thick.", false, false,
                   []() -> Result<StressSetup> {
                     PALPATE_ASSIGN(StressSetup setup,
                                    setup_of_generator("shells:extent_mm=20:gap_mm=0.2:points=12000"));
                     Way way({0.2, 0.1, 16});
                     way.to({0.2, 0.1, 13}, 50, Due::kFree).to({0.2, 0.1, 9.7}, 80, Due::kAny);
                     way.to({0.2, 0.1, 9}, 40, Due::kInside)
                         .to({0.2, 0.1, 13}, 80, Due::kAny)
                         .to({0, 0, 16}, 50, Due::kFree);
                     std::move(way).put_into(setup);
                     return setup;
                   }});
}

}  // namespace

void add_body_cases(std::vector<StressCase>& cases) {
  add_plates(cases);
  add_sharp(cases);
  add_open(cases);
  add_nested(cases);
}

}  // namespace palpate::experiments
